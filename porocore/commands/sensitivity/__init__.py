"""One load of the cell at a time: every response along it, as far as the cell can be solved."""
