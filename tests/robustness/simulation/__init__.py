"""Nodes, gateways and a cloud in one thread, under a seeded plan of faults."""
