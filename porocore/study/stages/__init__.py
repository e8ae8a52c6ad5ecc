"""The stages of a run: cell, sampling, training, macro solves, report, and the files between them."""
