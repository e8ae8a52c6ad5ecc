"""A cell solver for porocore: plane layers in closed form."""
