"""Section `calibration:` of a study, or a file of its own: unknowns, experiments, observations, fit."""
