"""Writing the store: one thread, one transaction for several batches."""
