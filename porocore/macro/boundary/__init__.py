"""Boundary data of a body: conditions, followers, frames of oblique nodes, symmetry planes, reactions, probes."""
