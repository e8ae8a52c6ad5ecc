"""Smooth motions by hand of the meshes of a cell, equilibria on them, and difference quotients of fourth order."""

from dataclasses import replace

import numpy as np

from porocore.cell.equilibrium.responses import follow
from porocore.testing.expect import STEPS, central_difference


def velocity(mesh):
    """V (nodes, 3), smooth, the same on opposite faces and tangential to them; it keeps the mirrors of an eighth."""
    low, high = mesh.low, mesh.high
    on_face = (mesh.points == low) | (mesh.points == high)
    turns = 2 * np.pi * np.where(mesh.points == high, low if mesh.domain == "whole" else high, mesh.points)
    turns /= np.array(mesh.sides)
    sine, cosine = np.sin(turns), np.cos(turns)
    if mesh.domain == "whole":
        cosine = np.cos(turns + 0.3)
    V = sine * (
        np.array([1.0, 0.8, -0.9]) + cosine @ np.array([[0, 0.5, 0.2], [0.4, 0, -0.3], [-0.3, 0.4, 0]])
    )
    return np.where(on_face, 0.0, 0.2 * V)


def moved(mesh, step, V=None):
    """The mesh with its nodes moved along V."""
    return replace(mesh, points=mesh.points + step * (velocity(mesh) if V is None else V))


def equilibrium(solver, cell, mesh, H, p):
    """The discrete solid of a cell on a mesh, and its equilibrium under (H, p)."""
    solid = solver.solid(cell, mesh)
    outcome = follow(solid, solid.iterate_at(np.zeros((3, 3)), 0.0), H, p, 1e-11)
    assert outcome.equilibrium is not None, outcome.status
    return solid, outcome.equilibrium


def quotient(function, step=1e-3):
    """The derivative at 0 of a function of one number, whose values are arrays or tuples of arrays."""
    values = [function(k * step) for k in STEPS]
    parts = zip(*values, strict=True) if isinstance(values[0], tuple) else [values]
    found = [central_difference(part, step) for part in parts]
    return tuple(found) if isinstance(values[0], tuple) else found[0]
