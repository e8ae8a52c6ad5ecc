"""The stages of a run: sampling, training, macro solves, report, and what one hands to the next."""
