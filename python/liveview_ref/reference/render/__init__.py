"""From warped photos and logits to a picture: blending, compositing, per-view occlusion."""
