"""Estimates of a surrogate's error at a state, and the component that drives it."""
