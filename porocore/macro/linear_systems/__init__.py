"""Linear systems of large bodies, for all backends: choice, coarse level, memory, reuse, work."""
