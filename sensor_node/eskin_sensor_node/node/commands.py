"""Commands at the node: verified, executed once, in time, and answered."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, Protocol

from eskin.errors import CommandError, EnvelopeError, EskinError, FlashError, IdentityError
from eskin.identity import ChainVerifier, IdentityKind
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Verifier
from eskin.wire.messages import Outcome
from eskin.wire.messages.command import CommandName, check_arguments
from eskin.wire.timestamp import LATEST, SECOND
from eskin.wire.topics import Stream, node_topic
from eskin_sensor_node.firmware import commander

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.identity import Identity
    from eskin.wire.messages.command import Arguments, State
    from eskin_sensor_node.firmware.outbox import Outbox

log = logging.getLogger(__name__)

_MOST_SECONDS: Final = LATEST // SECOND


class TypedControls(Protocol):
    """A node's settings; called by the thread that takes commands."""

    def apply(self, name: str, arguments: Arguments) -> State:
        """Apply a command, whole or not at all.

        Args:
            name: ``calibrate``, ``set``, ``reset``, ``monitor`` or ``challenge``.
            arguments: As `eskin.wire.messages.command.check_arguments` allows.

        Returns:
            The node's state: the settings of each place (channel, taxel, or ``*``).

        Raises:
            EskinError: It cannot be applied; the message has the value and the reason.
        """

    def restore(self, state: State) -> State:
        """Restore the last reported state at boot, leaving out what no longer fits.

        Args:
            state: The last reported one; empty where there is none.

        Returns:
            The node's state.
        """

    @property
    def state(self) -> State:
        """The node's state."""


class CommandReceiver:
    """Verifies commands of the cloud; the firmware executes them.

    Args:
        outbox: Stores the last command's result.
        own: The node's identity.
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
        controls: TypedControls,
        enclosure: Callable[[], tuple[int, int]],
    ) -> None:
        self._topic = node_topic(own.name, Stream.COMMANDS)
        self._enclosure = enclosure
        self._firmware = commander.Commander(own.name, outbox, _Checked(controls))
        trust = ChainVerifier.following(own.directory / ROOT_FILE, clock=self._now)
        self._started = False
        self._verifier = Verifier(trust, kind=IdentityKind.SERVER, name=cloud)

    def start(self) -> None:
        """Restore the state and report it; once, before any command.

        Raises:
            FlashError: The stored result cannot be read.
        """
        try:
            self._start()
        except FlashError as error:
            log.warning("state not reported yet: error=%s", error)
        except ValueError as error:
            raise FlashError(
                f"the stored result of the last command cannot be read: {error}"
            ) from error

    def report(self) -> None:
        """Store a state that changed by itself, and report it.

        Raises:
            FlashError: It could not be stored.
        """
        if not self._started:
            self._start()
        self._firmware.report(self._enclosure())

    def take(self, signed: bytes) -> None:
        """Execute a command that was sealed to this node.

        Args:
            signed: The COSE_Sign1 inside.

        Raises:
            FlashError: Its result was not stored. It is not answered, so it comes again, and
                then only the result is written.
        """
        if not self._started:
            # Without the stored result it might execute a command twice.
            self._start()
        try:
            plaintext = self._verifier.verify(signed, topic=self._topic)
            done = self._firmware.take(plaintext, self._enclosure())
        except (EnvelopeError, IdentityError, ValueError) as error:
            log.warning("command rejected: reason=%s", error)
            return
        if done is not None:
            number, name, outcome = done
            log.info(
                "command executed: name=%s id=%d outcome=%s",
                name,
                number,
                Outcome(outcome).name.lower(),
            )

    def _start(self) -> None:
        self._started = False
        self._firmware.start(self._enclosure())
        self._started = True

    def _now(self) -> datetime:
        seconds = min(self._enclosure()[1] // SECOND, _MOST_SECONDS)
        return datetime.fromtimestamp(seconds, UTC)


class _Checked:
    """Controls for the firmware: arguments are checked, errors become refusals."""

    __slots__ = ("_controls",)

    def __init__(self, controls: TypedControls) -> None:
        self._controls = controls

    def apply(self, name: str, arguments: dict[str, Any]) -> State:
        """Apply a command, or raise `Refusal`."""
        try:
            if name not in CommandName.__members__.values():
                raise CommandError("command", name, ", ".join(CommandName))
            checked = check_arguments(CommandName(name), arguments)
            return self._controls.apply(name, checked)
        except EskinError as error:
            raise commander.Refusal(_printable(str(error))) from error

    def restore(self, state: Any) -> State:
        """Restore the last reported state."""
        return self._controls.restore(state)

    @property
    def state(self) -> State:
        """The state."""
        return self._controls.state


def _printable(text: str) -> str:
    """A reason with printable characters only."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
