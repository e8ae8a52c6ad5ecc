"""porocore in a notebook: a study in a few lines, a cell in three, results as arrays."""
