"""Sentences and rows of the report: the cell, components of tensors, held-out errors, statuses."""
