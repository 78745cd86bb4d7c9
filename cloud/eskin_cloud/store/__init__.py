"""The store: one schema, a writer thread for each group of slots, several readers."""

from __future__ import annotations

from eskin_cloud.store.store import Store

__all__ = ["Store"]
