"""Algebra of many 3 × 3 tensors at once: cofactors, polar decomposition, logarithm, point groups."""
