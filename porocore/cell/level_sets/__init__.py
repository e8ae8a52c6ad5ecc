"""Pore geometries given by a level set: minimal surfaces, images, and their tetrahedra."""
