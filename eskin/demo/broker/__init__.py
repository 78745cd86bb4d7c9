"""The demo's embedded broker: amqtt on loopback, its known holes closed."""

from __future__ import annotations

from eskin.demo.broker.access import Party, may_publish, may_subscribe
from eskin.demo.broker.broker import LoopbackBroker

__all__ = ["LoopbackBroker", "Party", "may_publish", "may_subscribe"]
