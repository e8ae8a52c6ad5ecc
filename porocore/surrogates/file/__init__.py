"""The file of a surrogate, which every backend writes and reads."""
