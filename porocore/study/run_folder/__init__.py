"""The run folder: its lock, the paths of its files, and their provenance."""
