"""Calibration: unknowns of a study from measured curves, and their identifiability."""
