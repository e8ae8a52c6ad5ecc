"""Networks that stand in for the solid cell problem, trained and evaluated with PyTorch."""
