"""Biometric data: who may read it, and its decryption, in memory only."""

from __future__ import annotations
