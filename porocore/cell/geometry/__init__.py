"""Pore geometries that are drawn: channels, spheres, obstacles; and their interface."""
