"""Pore geometries that are drawn: channels, spheres, obstacles; and the choice among all kinds."""
