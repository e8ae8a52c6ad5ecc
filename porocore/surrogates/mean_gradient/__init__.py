"""<∇u¹>_s as a model: the linear limit of the cell plus a network."""
