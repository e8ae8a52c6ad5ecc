"""Boundary data of a body: conditions, followers, oblique frames, symmetry planes, reactions, probes."""
