"""Derivatives of a macro run by unknowns: what changes, followed with the steps (direct) or back over them (adjoint)."""
