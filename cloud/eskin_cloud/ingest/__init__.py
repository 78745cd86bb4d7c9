"""Ingest: who brings a batch, what is in it, and into the store with it."""

from __future__ import annotations
