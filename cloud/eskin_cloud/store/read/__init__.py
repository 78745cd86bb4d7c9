"""Reading the store: windows, rows of nodes and channels, blocks in a window."""
