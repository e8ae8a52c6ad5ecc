"""What the data say about the unknowns: intervals by profile likelihood, unseen directions, further data that help."""
