"""Which network is large enough: a grid of architectures trained on the samples of a run."""
