"""Stability of a cell: one-cell and period-two modes, loss of rank-one convexity, maps of both."""
