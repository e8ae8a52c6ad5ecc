"""Effective potential W(ln U, p) as a model: its data, its evaluation, its training."""
