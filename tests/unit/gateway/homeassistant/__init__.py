"""Home Assistant's own evaluation of the gateway's discovery."""
