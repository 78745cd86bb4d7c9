"""Questions to the store, and how they are answered from bounds before samples."""

from __future__ import annotations
