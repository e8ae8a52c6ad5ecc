"""Laws that every cell solver obeys."""
