"""Cell and macro solvers with dolfinx and PETSc."""
