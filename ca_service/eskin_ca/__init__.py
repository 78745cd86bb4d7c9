"""The CA service: enrols identities by one-time tokens, and gives out what is public."""
