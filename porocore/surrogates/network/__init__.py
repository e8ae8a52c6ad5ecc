"""Feed-forward networks in numpy, and their training whichever library differentiates."""
