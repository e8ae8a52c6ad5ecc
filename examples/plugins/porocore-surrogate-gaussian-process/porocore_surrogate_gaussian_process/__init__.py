"""A surrogate for porocore: a Gaussian process with its uncertainty."""
