"""Laws that every cell solver obeys, as suites to subclass, one group in each file."""
