"""The file of a surrogate, which every backend reads."""
