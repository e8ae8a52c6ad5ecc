"""Checks of every macro solver, as a suite to subclass, one group in each file."""
