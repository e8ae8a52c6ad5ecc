"""Conductivity of the deformed pore: Stokes flow through the fluid's mesh, moved along with the pore wall."""
