"""Posed photos, procedural scenes, and the training examples and held-out cases made of them."""
