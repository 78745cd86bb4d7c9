"""Executes commands: once, in time, by the node that they are for, with a result.

A modem or a secure element verifies the signature before, and hands over what was signed.
"""

from eskin_sensor_node.firmware.cbor import read_map
from eskin_sensor_node.firmware.message_writer import COMMAND

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, Protocol

    from eskin_sensor_node.firmware.message_writer import State
    from eskin_sensor_node.firmware.outbox import Outbox

    Time = tuple[int, int]
    """Earliest and latest UTC of the present in ns, as the node knows it."""

    class Controls(Protocol):
        """A node's settings."""

        def apply(self, name: str, arguments: "dict[str, Any]") -> State:
            """Apply a command, whole or not at all, or raise `Refusal`; gives the state."""

        def restore(self, state: State) -> State:
            """Restore the reported state, as far as it fits; gives the state."""

        @property
        def state(self) -> State:
            """The state."""


DONE = 0
REFUSED = 1
EXPIRED = 2
"""What became of a command."""
MOST_REASON = 200
"""Letters of the reason why it was not done."""
_KINDS = {1: int, 2: int, 3: str, 4: int, 5: int, 6: str, 7: dict}
"""Fields of a command: kind, id, node, when it was issued, when it expires, name, arguments."""
_SECOND = 1000000000


class Refusal(Exception):  # noqa: N818 - it is no error
    """A command cannot be done; its text is the reason."""


class Commander:
    """Executes the node's commands.

    The effect of a command is in memory only until its id, its result and the state behind are in
    flash, in one commit; a crash before undoes it, and a start after takes it up again. So it has
    one effect, however often it comes.

    Args:
        node: Its name.
        outbox: Stores the last command's result.
        controls: What can be set.
    """

    def __init__(self, node: str, outbox: "Outbox", controls: "Controls") -> None:
        self._node = node
        self._outbox = outbox
        self._controls = controls
        self._last: tuple[int, int, str | None] = (0, DONE, None)
        self._state: State = {}
        self._recorded = True

    def start(self, time: "Time") -> None:
        """Restore the state and report it; once, before any command.

        Raises:
            ValueError: What flash holds is no result.
        """
        kept = self._outbox.answer()
        state: State = {}
        if kept is not None:
            fields = read_map(kept)
            if 5 not in fields or 6 not in fields or 8 not in fields:
                raise ValueError("no result")
            self._last = fields[5], fields[6], fields.get(7)
            state = fields[8]
        self._state = self._controls.restore(state)
        self._record(time)

    def report(self, time: "Time") -> None:
        """Report a state that changed by itself, with the last command's result again."""
        self._state = self._controls.state
        self._record(time)

    def take(self, plaintext: bytes, time: "Time") -> "tuple[int, str, int] | None":
        """Take what the cloud has signed for this node.

        Where its result cannot be kept, it was not answered and comes again; then only the result
        is written.

        Returns:
            Its id, its name, and what became of it; ``None``: it was taken before.

        Raises:
            ValueError: It is no command to this node.
        """
        fields = _fields(plaintext)
        if fields[3] != self._node:
            raise ValueError("it is for " + fields[3])
        if fields[2] > self._last[0]:
            outcome, reason = self._do(fields, time[1])
            self._last = fields[2], outcome, reason
            self._recorded = False
            self._record(time)
            return fields[2], fields[6], outcome
        if not self._recorded:
            self._record(time)
        return None

    def _do(self, fields: "dict[int, Any]", latest: int) -> "tuple[int, str | None]":
        late = latest - fields[5]
        if late >= 0:
            seconds, rest = late // _SECOND, late % _SECOND
            return EXPIRED, f"it may have come {seconds}.{rest:09d} s too late"
        try:
            self._state = self._controls.apply(fields[6], fields[7])
        except Refusal as refusal:
            return REFUSED, str(refusal)[:MOST_REASON] or "no reason given"
        return DONE, None

    def _record(self, time: "Time") -> None:
        number, outcome, reason = self._last
        with self._outbox.batch() as batch:
            message_writer = self._outbox.message_writer
            batch.take([message_writer.result(time, number, outcome, reason, self._state)])
        self._recorded = True


def _fields(plaintext: bytes) -> "dict[int, Any]":
    """The fields of a command."""
    fields = read_map(plaintext)
    if set(fields) != set(_KINDS):
        raise ValueError("no command: other fields are expected")
    for key, kind in _KINDS.items():
        if not isinstance(fields[key], kind):
            raise ValueError("no command: field " + str(key) + " is of another kind")  # noqa: TRY004
    if fields[1] != COMMAND or fields[2] < 1:
        raise ValueError("no command: its kind or its id is another one")
    return fields
