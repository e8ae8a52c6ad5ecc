"""Sampling: the states that are solved, the workers that solve them, and the file that keeps them."""
