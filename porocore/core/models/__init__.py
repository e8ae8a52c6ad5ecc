"""Pieces of configuration models: bounds on numbers, and the choice of a model by its ``kind``."""
