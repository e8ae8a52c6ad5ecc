"""Composition of a body: regions, fields of the cell's parameters, material axes, and laws that read them."""
