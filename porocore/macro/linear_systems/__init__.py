"""Linear systems of large bodies: what the iterations of all backends share."""
