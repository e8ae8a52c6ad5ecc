"""Evidence: known answers, backends against each other, publications recomputed, studies of one cell."""
