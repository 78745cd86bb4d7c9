"""Rollups: exact hulls of samples over ever longer buckets."""

from __future__ import annotations
