"""File of a surrogate, which every backend reads."""
