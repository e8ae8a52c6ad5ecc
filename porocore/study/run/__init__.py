"""One run: its folder, its parts put together, its stages from cell to report, its results."""
