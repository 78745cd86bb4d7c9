"""The REST interface: one router a resource."""

from __future__ import annotations
