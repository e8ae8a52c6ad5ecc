"""Boundary data of a body: conditions, followers, frames of oblique nodes, reactions, probes."""
