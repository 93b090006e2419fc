"""The paper's comparisons, repeated: its rigs, the methods it compares with, its
ablations and tables.

Every method renders from the same photos by the same cameras (methods/method.py), is trained on the
same scenes for the same number of samples (train.py) and is scored on scenes that no training has
seen (measure/score.py). report/ writes the page from the results in models/paper."""
