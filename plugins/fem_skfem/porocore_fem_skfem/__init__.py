"""Cell and macro solvers with scikit-fem."""
