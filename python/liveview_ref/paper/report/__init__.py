"""The page of the comparison, from the results in models/paper."""
