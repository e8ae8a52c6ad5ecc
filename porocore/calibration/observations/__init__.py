"""Measured curves: CSV tables with units, standard deviations, the same curves of a solution, made-up data."""
