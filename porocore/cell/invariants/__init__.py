"""Strain energies as formulas of the invariants of C, and their derivatives."""
