"""Conductivity of the deformed pore as a learned model, with its error estimate."""
