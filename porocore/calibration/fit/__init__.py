"""Bounded least squares from several starts; every evaluation is kept, so that a killed fit goes on."""
