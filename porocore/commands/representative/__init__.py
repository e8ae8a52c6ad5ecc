"""Size of a representative volume: sub-volumes of an image, each solved as a cell."""
