"""The paper's own comparisons, made anew: its rigs, the methods it compares with, its ablations and tables.

Every method renders from the same photos by the same cameras (method.py), is trained on the same scenes for the same
number of samples (train.py) and scored on scenes that no training has seen (score.py)."""
