"""Calibration: unknowns of a study from measured curves, and what the curves do not tell."""
