"""Feed-forward networks in numpy, and their training with any library that differentiates."""
