"""The run folder: who may write it, where each file lies, and what its files come from."""
