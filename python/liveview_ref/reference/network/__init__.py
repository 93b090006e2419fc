"""Logits without a network."""
