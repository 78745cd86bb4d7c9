"""A sequence of gestures that releases a signature of the node; see docs/gesture-key.md."""

from __future__ import annotations

import base64
import logging
from typing import TYPE_CHECKING, Final

from eskin.errors import CommandError, FlashError, IdentityError
from eskin.wire.messages import Release
from eskin_sensor_node.firmware import gesture_lock
from eskin_sensor_node.firmware.gesture_lock import GestureLock
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin.wire.messages.command import Value
    from eskin_sensor_node.settings import GestureKeySection

log = logging.getLogger(__name__)

_OUTCOMES: Final = {
    gesture_lock.IDLE: "none",
    gesture_lock.WAITING: "waiting",
    gesture_lock.COMPLETE: "judged",
    gesture_lock.RELEASED: "released",
    gesture_lock.WRONG: "wrong",
    gesture_lock.EXPIRED: "expired",
}


class GestureKey:
    """Takes challenges, and signs one where its gestures were entered for certain.

    Args:
        section: Its settings.
        node: The node's name.
        enclosure: Earliest and latest UTC of the present in ns, as the node knows it.

    Attributes:
        gestures: Names of the monitors that belong to it: their verdicts are not stated.
        lock: The firmware's part, since the latest boot.
        sign: Signs with the node's device key; ``None``: it has none.
        report: Stores the node's state in flash and reports it.
    """

    def __init__(
        self, section: GestureKeySection, node: str, enclosure: Callable[[], tuple[int, int]]
    ) -> None:
        self._section = section
        self._node = node
        self._enclosure = enclosure
        self.gestures = frozenset(section.gestures)
        self.sign: Callable[[bytes], bytes] | None = None
        self.report: Callable[[], None] = lambda: None
        self.boot()

    def boot(self) -> None:
        """Start with an empty RAM."""
        section = self._section
        self._nonce = self._signature = ""
        self.lock = GestureLock(
            section.gestures,
            section.sequence,
            timeout=round(section.timeout_s * BILLION),
            attempts=section.attempts,
            lockout=round(section.lockout_s * BILLION),
        )

    @property
    def state(self) -> dict[str, Value]:
        """Its place in the node's state."""
        state: dict[str, Value] = {
            "outcome": _OUTCOMES[self.lock.outcome],
            "failures": float(self.lock.failures),
            "unclear": float(self.lock.unclear),
        }
        return state | {
            name: text
            for name, text in (("nonce", self._nonce), ("signature", self._signature))
            if text
        }

    def restore(self, settings: Mapping[str, Value], now: int) -> None:
        """Continue the count of wrong entries after a start."""
        self.lock.restore(int(float(settings.get("failures", 0.0))), now)

    def challenge(self, nonce: str, now: int) -> None:
        """Await the gestures for a nonce, from now on.

        Raises:
            CommandError: The node has no key, or it is locked.
        """
        if not self.gestures or self.sign is None:
            raise CommandError("command", "challenge", "set or reset; the node has no gesture key")
        locked = self.lock.locked(now)
        if locked:
            raise CommandError(
                "nonce", nonce, f"none for {locked / BILLION:.0f} s, as {self.lock.failures} "
                "entries in a row were wrong",
            )  # fmt: skip
        self._nonce, self._signature = nonce, ""
        self.lock.challenge(now)

    def settle(self, now: int) -> None:
        """Store and report what changed; between two commits of the node's messages."""
        lock = self.lock
        if not lock.changed:
            return
        lock.changed = False
        try:
            self.report()
            if lock.outcome == gesture_lock.COMPLETE:
                lock.judge(now)
                self._release(now)
                self.report()
        except FlashError as error:
            # Where its count is not stored, an entry is not judged.
            if lock.outcome == gesture_lock.COMPLETE:
                lock.refuse(now)
            log.error("gesture key not stored: error=%s", error)  # noqa: TRY400 - one line
        log.info("gesture key: outcome=%s failures=%d", _OUTCOMES[lock.outcome], lock.failures)

    def _release(self, now: int) -> None:
        if self.lock.outcome != gesture_lock.RELEASED or self.sign is None:
            return
        release = Release(self._node, bytes.fromhex(self._nonce), self._enclosure())
        try:
            self._signature = base64.b64encode(self.sign(release.encode())).decode()
        except IdentityError as error:
            # A right entry is not counted; it can be made again for another challenge.
            self.lock.refuse(now)
            log.error("gesture key not signed: error=%s", error)  # noqa: TRY400 - one line
