"""From the depths of photos to the target's surface: edges, confirmed by other photos,
projected, averaged, holes filled."""
