"""Composition of a body: regions, fields of the cell's parameters, material axes; their values at its points."""
