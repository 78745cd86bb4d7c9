"""Remote commands: issued and signed here, fetched by gateways, answered by nodes."""
