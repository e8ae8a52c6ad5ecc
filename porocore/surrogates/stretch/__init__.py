"""Logarithmic stretch L = ln U of F = R U, and derivatives through it."""
