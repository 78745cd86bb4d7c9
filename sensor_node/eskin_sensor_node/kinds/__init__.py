"""Kinds of sensing element: a folder each, and what they share."""
