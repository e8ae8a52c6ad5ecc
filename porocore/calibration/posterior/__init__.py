"""Posterior distribution of the unknowns: draws on interpolated residuals, which exact runs check."""
