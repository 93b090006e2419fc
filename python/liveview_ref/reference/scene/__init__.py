"""Posed photos."""
