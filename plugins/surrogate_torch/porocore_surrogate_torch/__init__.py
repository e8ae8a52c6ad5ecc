"""A sigmoid network, trained with PyTorch, that stands in for the solid cell problem."""
