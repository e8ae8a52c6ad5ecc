"""Derivatives of a macro run by unknowns: what changes, followed with the steps or back over them."""
