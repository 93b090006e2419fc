"""Tools that make the example scenes, the tables of the model cards, the figures of README.md and
docs/, and the report on video."""
