"""A sampler for porocore: a grid of states in the box of the inputs."""
