"""Queries of stored series, events and lists."""

from __future__ import annotations
