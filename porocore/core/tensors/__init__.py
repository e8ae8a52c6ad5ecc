"""Algebra of many 3 × 3 tensors at once."""
