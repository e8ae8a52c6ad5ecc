"""Sampled inputs: the components of (H, p) that vary, their box, and the range that was sampled."""
