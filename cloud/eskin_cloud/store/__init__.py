"""The store: one schema, one writer thread, several readers."""

from __future__ import annotations

from eskin_cloud.store.store import Store

__all__ = ["Store"]
