"""Many nodes in one process."""
