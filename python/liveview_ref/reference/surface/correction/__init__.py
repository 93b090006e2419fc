"""Photos brought to the same exposure and sharpness, measured on their correspondences."""
