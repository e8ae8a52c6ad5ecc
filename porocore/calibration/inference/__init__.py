"""Statements of the data: intervals by profile likelihood, unseen directions, further data that help."""
