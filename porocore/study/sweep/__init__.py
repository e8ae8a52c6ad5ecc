"""Sweeps over parameters of the cell: one family is sampled and learned once, the body solved for each value."""
