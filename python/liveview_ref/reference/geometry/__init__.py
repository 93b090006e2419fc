"""Cameras, and where a pixel of one camera lies in another."""
