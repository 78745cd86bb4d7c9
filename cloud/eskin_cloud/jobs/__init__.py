"""Background jobs of the cloud."""
