"""The photos' own depth (multi-view stereo), and the target's surface from it: twins of the library's mvs folder.

Maps are [h, w], photos [3, h, w]; disparities in 1/scene unit. The dtype is that of the photos or of the map that a
stage is given. Lengths in px are pixels of parallax.
"""
