"""A block of whole cells as one periodic mesh, by translation: what the classes of the eighth are held against."""

from functools import cached_property

import numpy as np

from porocore.cell.meshing.mesh import CellMesh


class Block(CellMesh):
    """``counts`` cells along each axis."""

    counts = (1, 1, 1)

    @cached_property
    def periodic_class(self):
        wrapped = np.mod((self.points + 0.5).round(9), np.array(self.counts, float))
        return np.unique(wrapped, axis=0, return_inverse=True)[1].reshape(-1)


def block(whole, counts):
    """Of a mesh of the whole cell."""
    shifts = [np.array(k) for k in np.ndindex(*counts)]
    points = np.concatenate([whole.points + shift for shift in shifts])
    cells = np.concatenate([whole.cells + i * len(whole.points) for i in range(len(shifts))])
    merged, inverse = np.unique(points.round(9), axis=0, return_inverse=True)
    mesh = Block("solid", "whole", merged, inverse.reshape(-1)[cells])
    object.__setattr__(mesh, "counts", counts)
    return mesh
