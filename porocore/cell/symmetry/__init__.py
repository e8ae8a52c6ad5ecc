"""Symmetry of a cell and of its states: point groups of point sets and meshes, parities, exchanges."""
