"""Interleavings: the statements of several clouds on one store, in every order."""
