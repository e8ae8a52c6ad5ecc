"""A sampler for porocore: Halton sequences."""
