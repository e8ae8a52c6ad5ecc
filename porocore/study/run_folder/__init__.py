"""The run folder: its lock, the paths of its files, their provenance, and what a resumed run need not do again."""
