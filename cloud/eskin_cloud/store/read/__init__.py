"""Reading the store: windows, nodes and channels, samples of patches and columns."""
