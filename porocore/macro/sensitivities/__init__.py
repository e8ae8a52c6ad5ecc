"""Exact derivatives of a macro run by unknowns: their directions, the recursion over the steps, the histories."""
