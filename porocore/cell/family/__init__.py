"""Cells with parameters: numbers in ranges, members of the family at given values, the mesh that moves with them."""
