"""Surrogates that need no other library, and what those of the plugins share: models, numpy evaluation, files."""
