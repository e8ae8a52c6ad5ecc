"""Checks of every cell solver, as suites to subclass, one group in each file."""
