"""What makes the example scenes, the tables of the model cards, the numbers of README.md and the
report on video."""
