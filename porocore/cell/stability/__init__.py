"""Where a cell leaves the state that is solved for: one-cell and period-two modes, loss of rank-one convexity, maps."""
