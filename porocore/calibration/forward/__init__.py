"""Curves of one or more studies as functions of the unknowns: surrogate of the family, body, sensitivities."""
