"""Laws that every macro solver obeys, as a suite to subclass, one group in each file."""
