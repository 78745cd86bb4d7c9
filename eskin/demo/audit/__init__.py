"""The end-to-end check of the enclosure law: what is stored holds what was true."""

from __future__ import annotations

from eskin.demo.audit.audit import Audit, audit
from eskin.demo.audit.channel import ChannelAudit

__all__ = ["Audit", "ChannelAudit", "audit"]
