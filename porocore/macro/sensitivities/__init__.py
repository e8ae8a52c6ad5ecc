"""Derivatives of a macro run by unknowns: their directions, the equations of each step, the histories."""
