"""Taxels of one kind as columns of arrays."""
