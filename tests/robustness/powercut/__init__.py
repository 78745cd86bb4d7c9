"""Power cuts: stores are cut at any byte, and must open again with all that was acknowledged."""
