"""HDF5 files: written whole or not at all, and read only as far as they are what they should be."""

from porocore.core.hdf5.contents import UNREADABLE, Contents, Kind, damaged, opened
from porocore.core.hdf5.writing import atomic_hdf5

__all__ = ["UNREADABLE", "Contents", "Kind", "atomic_hdf5", "damaged", "opened"]
