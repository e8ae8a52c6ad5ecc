"""What a run leaves for people to read: figures of merit, figures, and one self-contained HTML page."""
