"""Who may read what tells of a person, and how it is read: in memory, never on the disk."""

from __future__ import annotations
