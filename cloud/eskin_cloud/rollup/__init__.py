"""The pyramid: exact hulls of ever longer stretches, kept while blocks arrive, and read back."""

from __future__ import annotations
