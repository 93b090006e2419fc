"""Scores of a network on held-out photos, and of baselines without one."""
