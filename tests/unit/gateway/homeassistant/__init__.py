"""Home Assistant's own word on what the gateway announces."""
