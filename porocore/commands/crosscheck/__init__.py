"""Every installed backend on one case, each held against the others."""
