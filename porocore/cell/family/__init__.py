"""Cells with parameters: numbers in ranges, members at given values, the mesh that moves with them."""
