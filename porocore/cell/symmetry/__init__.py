"""Symmetry of a cell and of its states: point groups, parities, exchanges of axes."""
