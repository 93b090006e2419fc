"""Procedural training scenes: random textured surfaces at known depths, seen by random cameras."""
