"""The Python interface: studies, cells, results as arrays."""
