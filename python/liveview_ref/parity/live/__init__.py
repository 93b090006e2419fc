"""Parity of one render of your own scene: dump, stages in both precisions, verdicts."""
