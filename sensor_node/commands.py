"""Commands at the node: taken from the cloud only, done once, in time, and answered."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final, Protocol

from eskin.envelope import Verifier
from eskin.errors import EnvelopeError, EskinError, FlashError, IdentityError, MessageError
from eskin.identity import IdentityKind, Trust
from eskin.identity.identity import ROOT_FILE
from eskin.messages import Command, Outcome, Result
from eskin.messages.result import MOST_REASON
from eskin.moment import LATEST, SECOND, format_moment
from eskin.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.identity import Identity
    from eskin.messages.vocabulary import Arguments, State
    from sensor_node.firmware.outbox import Outbox

log = logging.getLogger(__name__)

_MOST_SECONDS: Final = LATEST // SECOND


class Controls(Protocol):
    """What can be set of a node; called by the thread that takes commands."""

    def apply(self, name: str, arguments: Arguments) -> State:
        """Do what a command asks, whole or not at all.

        Args:
            name: ``calibrate``, ``set`` or ``reset``.
            arguments: As `eskin.messages.vocabulary.check_arguments` allows.

        Returns:
            How the node is set now: the settings of each place (channel, taxel, or ``*``).

        Raises:
            EskinError: It cannot be done; the message says which value is not allowed, and why.
        """

    def restore(self, state: State) -> State:
        """Take up, at a start, what was reported before; what does not fit any more is left out.

        Args:
            state: The last reported one; empty where there is none.

        Returns:
            How the node is set now.
        """


class Commander:
    """Does what the cloud asks of this node.

    The effect of a command lives in memory until its id, its result and the state behind are in
    flash, in one commit; a crash before undoes it, and a start after takes it up again. So it has
    one effect, however often it comes.

    Args:
        outbox: Keeps the last command's result, and tells it.
        own: Who the node is.
        cloud: Common name of the only server that may command.
        controls: What can be set.
        enclosure: Earliest and latest UTC of the present in ns, as the node knows it.
    """

    def __init__(
        self,
        outbox: Outbox,
        *,
        own: Identity,
        cloud: str,
        controls: Controls,
        enclosure: Callable[[], tuple[int, int]],
    ) -> None:
        self._outbox = outbox
        self._node = own.name
        self._topic = node_topic(own.name, Stream.COMMANDS)
        self._controls = controls
        self._enclosure = enclosure
        trust = Trust.following(own.directory / ROOT_FILE, clock=self._now)
        self._verifier = Verifier(trust, kind=IdentityKind.SERVER, name=cloud)
        self._last: tuple[int, Outcome, str | None] = (0, Outcome.DONE, None)
        self._state: State = {}
        self._recorded = True

    def start(self) -> None:
        """Take up the state of before, and say how the node is set; once, before any command.

        Raises:
            FlashError: Flash cannot be read.
        """
        body = self._outbox.answer()
        kept = None if body is None else Result.decode(body)
        if kept is not None:
            self._last = kept.command, kept.outcome, kept.reason
        self._state = self._controls.restore({} if kept is None else kept.state)
        try:
            self._record()
        except FlashError as error:
            log.warning("the node's state is told later: error=%s", error)

    def take(self, signed: bytes) -> None:
        """Take a command that was sealed to this node.

        Args:
            signed: The COSE_Sign1 inside.

        Raises:
            FlashError: Its result could not be kept. It was not answered, so it comes again, and
                then only the result is written.
        """
        try:
            command = Command.decode(self._verifier.verify(signed, topic=self._topic))
        except (EnvelopeError, IdentityError, MessageError) as error:
            log.warning("command rejected: reason=%s", error)
            return
        if command.node != self._node:
            log.warning("command rejected: reason=it is for %s", command.node)
        elif command.id > self._last[0]:
            self._do(command)
        elif not self._recorded:
            self._record()

    def _do(self, command: Command) -> None:
        outcome, reason = Outcome.DONE, None
        latest = self._enclosure()[1]
        if latest >= command.expires:
            outcome = Outcome.EXPIRED
            reason = (
                f"it was to be done before {format_moment(command.expires)}, "
                f"and here it may be {format_moment(latest)} already"
            )
        else:
            try:
                self._state = self._controls.apply(str(command.name), command.arguments)
            except EskinError as error:
                outcome, reason = Outcome.REFUSED, _printable(str(error))
        self._last = command.id, outcome, reason
        self._recorded = False
        log.info("command %s: id=%d outcome=%s", command.name, command.id, outcome.name.lower())
        self._record()

    def _record(self) -> None:
        number, outcome, reason = self._last
        with self._outbox.batch() as batch:
            scribe, time = self._outbox.scribe, self._enclosure()
            batch.take([scribe.result(time, number, int(outcome), reason, self._state)])
        self._recorded = True

    def _now(self) -> datetime:
        seconds = min(self._enclosure()[1] // SECOND, _MOST_SECONDS)
        return datetime.fromtimestamp(seconds, UTC)


def _printable(text: str) -> str:
    """A reason as a result can tell it."""
    shown = "".join(letter if letter.isprintable() else " " for letter in text)
    return shown[:MOST_REASON] or "no reason given"
