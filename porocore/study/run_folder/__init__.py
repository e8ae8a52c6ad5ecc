"""Run folder: its lock, paths of its files, their provenance, record of a finished run."""
