"""Choice of a network's size: a grid of architectures trained on the samples of a run."""
