"""Frictionless self-contact of the pore wall, as one more share of the energy."""
