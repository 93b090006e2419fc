"""The page of the comparison and the card of its networks, from the results in models/paper."""
