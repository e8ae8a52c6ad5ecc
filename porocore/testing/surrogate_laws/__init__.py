"""Laws that every surrogate obeys, as suites to subclass, one group in each file."""
