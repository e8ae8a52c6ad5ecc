"""Findings of a study: reach, held-out errors, the cell over its parameters, the cells of the body."""
