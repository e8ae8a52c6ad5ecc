"""Checks of every surrogate, as suites to subclass, one group in each file."""
