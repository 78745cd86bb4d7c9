"""Commands at the node: taken from the cloud only, done once, in time, and answered."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, Protocol

from eskin.errors import CommandError, EnvelopeError, EskinError, FlashError, IdentityError
from eskin.identity import ChainVerifier, IdentityKind
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Verifier
from eskin.wire.messages import Outcome
from eskin.wire.messages.command_schema import CommandName, check_arguments
from eskin.wire.timestamp import LATEST, SECOND
from eskin.wire.topics import Stream, node_topic
from eskin_sensor_node.firmware import commander

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.identity import Identity
    from eskin.wire.messages.command_schema import Arguments, State
    from eskin_sensor_node.firmware.outbox import Outbox

log = logging.getLogger(__name__)

_MOST_SECONDS: Final = LATEST // SECOND


class Controls(Protocol):
    """What can be set of a node; called by the thread that takes commands."""

    def apply(self, name: str, arguments: Arguments) -> State:
        """Do what a command asks, whole or not at all.

        Args:
            name: ``calibrate``, ``set`` or ``reset``.
            arguments: As `eskin.wire.messages.command_schema.check_arguments` allows.

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
    """Takes from the cloud what it asks of this node; the firmware decides what becomes of it.

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
        self._topic = node_topic(own.name, Stream.COMMANDS)
        self._enclosure = enclosure
        self._firmware = commander.Commander(own.name, outbox, _Checked(controls))
        trust = ChainVerifier.following(own.directory / ROOT_FILE, clock=self._now)
        self._started = False
        self._verifier = Verifier(trust, kind=IdentityKind.SERVER, name=cloud)

    def start(self) -> None:
        """Take up the state of before, and say how the node is set; once, before any command.

        Raises:
            FlashError: The last result that it kept makes no sense.
        """
        try:
            self._start()
        except FlashError as error:
            log.warning("the node's state is told later: error=%s", error)
        except ValueError as error:
            raise FlashError(f"the last result that it kept cannot be read: {error}") from error

    def take(self, signed: bytes) -> None:
        """Take a command that was sealed to this node.

        Args:
            signed: The COSE_Sign1 inside.

        Raises:
            FlashError: Its result could not be kept. It was not answered, so it comes again, and
                then only the result is written.
        """
        if not self._started:
            # It would not know what it has done already.
            self._start()
        try:
            plaintext = self._verifier.verify(signed, topic=self._topic)
            done = self._firmware.take(plaintext, self._enclosure())
        except (EnvelopeError, IdentityError, ValueError) as error:
            log.warning("command rejected: reason=%s", error)
            return
        if done is not None:
            number, name, outcome = done
            log.info("command %s: id=%d outcome=%s", name, number, Outcome(outcome).name.lower())

    def _start(self) -> None:
        self._started = False
        self._firmware.start(self._enclosure())
        self._started = True

    def _now(self) -> datetime:
        seconds = min(self._enclosure()[1] // SECOND, _MOST_SECONDS)
        return datetime.fromtimestamp(seconds, UTC)


class _Checked:
    """Controls as the firmware has them: what is not allowed is refused, with its reason."""

    __slots__ = ("_controls",)

    def __init__(self, controls: Controls) -> None:
        self._controls = controls

    def apply(self, name: str, arguments: dict[str, Any]) -> State:
        """Do what a command asks, or raise `Refusal`."""
        try:
            if name not in CommandName.__members__.values():
                raise CommandError("command", name, ", ".join(CommandName))
            checked = check_arguments(CommandName(name), arguments)
            return self._controls.apply(name, checked)
        except EskinError as error:
            raise commander.Refusal(_printable(str(error))) from error

    def restore(self, state: Any) -> State:
        """Take up what was reported before."""
        return self._controls.restore(state)


def _printable(text: str) -> str:
    """A reason as a result can tell it."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
