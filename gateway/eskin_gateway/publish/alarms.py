"""Publishes alarms of the cloud's monitors, until the broker has each."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Final

import orjson

from eskin.wire.topics import ALARMS, alarm_topic

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from eskin_gateway.mqtt.transport import Publication

RESEND_S: Final = 5.0
"""Seconds after which a change is published again that the broker has not sent back."""
_DELETED: Final = "deleted"


@dataclass(slots=True)
class _Change:
    number: int
    monitor: str
    document: bytes
    deleted: bool
    published: float | None = None


class AlarmPublisher:
    """Changes of alarms that the cloud has given, in their order.

    Shared by the thread that fetches them, the one that publishes and the one that reads from the
    broker. Of each monitor one change at a time is published, and retained. The gateway subscribes
    to what it publishes: what the broker sends back it has.

    Nothing of it is durable: after a start, and after each connection to the broker, the cloud is
    asked for the latest state of all monitors again.

    Args:
        discovery_prefix: Home Assistant's discovery topic; ``None`` where nothing is announced.
    """

    def __init__(self, discovery_prefix: str | None) -> None:
        self._discovery_prefix = discovery_prefix
        self._lock = Lock()
        self._waiting: dict[str, deque[_Change]] = {}
        self._last = 0
        self._begun = False

    @property
    def published(self) -> int | None:
        """Up to which number all is published; ``None`` before all of the first ones are."""
        with self._lock:
            if not self._begun and not self._waiting and self._last:
                self._begun = True
            if not self._begun:
                return None
            waiting = [changes[0].number - 1 for changes in self._waiting.values()]
            return min([self._last, *waiting])

    @property
    def idle(self) -> bool:
        """Whether the broker has all that was given."""
        with self._lock:
            return not self._waiting

    def restart(self) -> None:
        """Ask for everything again: the broker may have lost what it retained."""
        with self._lock:
            self._waiting, self._last, self._begun = {}, 0, False

    def give(self, changes: Iterable[tuple[int, str, bytes]]) -> None:
        """Take changes of the cloud: number, monitor and document, in ascending order."""
        with self._lock:
            for number, monitor, document in changes:
                if number <= self._last:
                    continue
                self._last = number
                deleted = orjson.loads(document)["transition"] == _DELETED
                waiting = self._waiting.setdefault(monitor, deque())
                waiting.append(_Change(number, monitor, document, deleted))

    def due(self, now: float) -> list[Publication]:
        """What is published now.

        Args:
            now: Monotonic seconds.
        """
        found: list[Publication] = []
        with self._lock:
            for changes in self._waiting.values():
                change = changes[0]
                if change.published is None or now >= change.published + RESEND_S:
                    change.published = now
                    found += self._publications(change)
        return found

    def confirm(self, topic: str, payload: bytes) -> None:
        """Note what the broker has sent back."""
        monitor = topic.removeprefix(f"{ALARMS}/")
        with self._lock:
            changes = self._waiting.get(monitor)
            if not changes or changes[0].published is None:
                return
            if payload != (b"" if changes[0].deleted else changes[0].document):
                return
            changes.popleft()
            if not changes:
                del self._waiting[monitor]

    def _publications(self, change: _Change) -> Iterator[Publication]:
        if self._discovery_prefix is not None:
            topic = f"{self._discovery_prefix}/binary_sensor/eskin_{change.monitor}/config"
            yield topic, b"" if change.deleted else _config(change.monitor), True
        yield alarm_topic(change.monitor), b"" if change.deleted else change.document, True


def _config(monitor: str) -> bytes:
    """JSON configuration of a monitor as a binary sensor, which is on while its alarm is raised.

    Source: home-assistant.io/integrations/binary_sensor.mqtt.
    """
    topic = alarm_topic(monitor)
    item = {
        "name": monitor,
        "unique_id": f"eskin_monitor_{monitor}",
        "object_id": f"eskin_{monitor.replace('-', '_')}",
        "device_class": "problem",
        "state_topic": topic,
        "value_template": "{{ 'ON' if value_json.state == 'raised' else 'OFF' }}",
        "json_attributes_topic": topic,
        "json_attributes_template": "{{ (value_json.alarm or {}) | tojson }}",
        "device": {
            "identifiers": ["eskin_monitors"],
            "name": "eskin monitors",
            "manufacturer": "eskin",
        },
        "origin": {"name": "eskin"},
    }
    return orjson.dumps(item)
