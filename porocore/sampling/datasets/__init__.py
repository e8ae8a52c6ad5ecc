"""Data sets of solved states: their file, its lock, checks, merging and export."""
