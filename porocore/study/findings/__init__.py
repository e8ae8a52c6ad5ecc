"""What the results of a study tell beyond their numbers: reach, held-out errors, the cell over its parameters."""
