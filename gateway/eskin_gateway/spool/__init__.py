"""What the gateway keeps on disk: queued messages, node states, certificates, subjects."""
