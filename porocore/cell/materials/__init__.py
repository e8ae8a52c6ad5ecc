"""Strain energies of the solid, by the ``kind`` that the user writes."""
