"""Checks and notes before the first solve: plugins, ranges, cost, symmetry, resolution, time functions."""
