"""One periodic cell: geometry, mesh, material, equilibrium, self-contact, conductivity and stability."""
