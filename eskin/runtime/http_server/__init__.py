"""HTTPS listeners: limits on connections, sizes and time, and client certificates."""
