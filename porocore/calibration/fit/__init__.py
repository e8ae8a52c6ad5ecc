"""Bounded least squares from several starts, in rounds with further cells; every evaluation is kept."""
