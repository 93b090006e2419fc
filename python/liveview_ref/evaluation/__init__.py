"""Scores of a network on held-out photos, beside renderers without one."""
