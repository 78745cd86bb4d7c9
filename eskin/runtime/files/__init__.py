"""Files that survive a power cut: locks, atomic replacement, append-only logs."""
