"""Report of a run: figures of merit, figures, and one self-contained HTML page."""
