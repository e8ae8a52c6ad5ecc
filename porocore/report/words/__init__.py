"""Words and rows of the report: the cell, its states."""
