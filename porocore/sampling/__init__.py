"""Which states are solved, where, by whom, and the file that keeps them."""
