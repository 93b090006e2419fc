"""Scores, cost and departures of the methods, written to models/paper."""
