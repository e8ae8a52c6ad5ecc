"""Bounded least squares from several starts, with every evaluation kept so that a fit goes on where it was killed."""
