"""Generators of documentation, and of what other languages read."""
