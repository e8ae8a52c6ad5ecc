"""Surrogates in numpy, and what those of the plugins share: models, evaluation, files."""
