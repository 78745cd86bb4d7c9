"""Operation: health, keys, and subjects kept in step with the cloud."""
