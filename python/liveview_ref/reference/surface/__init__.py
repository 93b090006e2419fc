"""Surface layers: the depth of the photos (multi-view stereo), and the target's surface from it.
render.py makes the default picture; the other files are its stages.

Maps are [h, w], photos [3, h, w]; disparities in 1/scene unit. The dtype is that of the photos or
of the map that a stage is given. Lengths in px are pixels of parallax.
"""
