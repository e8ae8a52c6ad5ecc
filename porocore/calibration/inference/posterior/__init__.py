"""Posterior distribution of the unknowns: an ensemble sampler on interpolated residuals, which exact runs check."""
