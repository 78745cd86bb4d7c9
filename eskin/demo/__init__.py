"""The whole stack on one machine, for a first look: PKI, broker, gateway, cloud and nodes."""
