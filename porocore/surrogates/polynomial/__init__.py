"""Least-squares polynomials: monomials, invariants of the point group, fits, committees."""
