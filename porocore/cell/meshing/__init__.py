"""Meshes of the solid and of the fluid: tetrahedra, quadrature, mirrors, periodicity, connectivity."""
