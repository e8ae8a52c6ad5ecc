"""Integration in time, the same for every backend: steps, Newton, error control, checkpoints."""
