"""From the depths of photos to the target's surface: confirmed by other photos, projected,
averaged, holes filled."""
