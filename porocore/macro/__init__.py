"""The body at the macroscale: problem, mesh, laws, boundary data and integration in time."""
