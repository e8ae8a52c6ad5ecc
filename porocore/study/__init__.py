"""One study in one folder: configuration, checks before a run, stages, run folder, Python interface."""
