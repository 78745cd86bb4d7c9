"""Commands, cloud to node, signed by the cloud (COSE_Sign1), and the results that answer them.

Names and values are those of robot skin (iCub's skinManager). A *place* is what a setting belongs
to: a channel (``t01.capacitance``), a taxel (``t01``), or the whole node (``*``). A *state* holds
the settings of each place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Final, Self, TypeAlias

from eskin.errors import CommandError, IdentityError, MessageError
from eskin.wire.messages.cbor_map import MOST_COUNT, dump, load, read_map, read_texts, sort_texts
from eskin.wire.messages.header import CHANNEL, Kind, Position, position_fields, read_position
from eskin.wire.timestamp import MOST_INSTANT

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.wire.messages.cbor_map import Fields

Value: TypeAlias = float | str
Arguments: TypeAlias = dict[str, Value]
State: TypeAlias = dict[str, dict[str, Value]]
WHOLE_NODE: Final = "*"
"""The place of what holds for all taxels."""
TAXEL: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,30}")
MONITOR_PLACE: Final = "monitor:"
"""What a monitor's place begins with; its name follows."""
KEY_PLACE: Final = "key:gesture"
"""The place of a node's gesture key."""
NONCE: Final = re.compile(r"[0-9a-f]{32}")
"""A challenge's nonce: 16 bytes in hexadecimal."""
MOST_FORMULA: Final = 1000
"""Characters of a monitor's formula."""
SWITCH: Final = ("on", "off")
NEVER: Final = "never"
ON: Final = ("possible", "certain", NEVER)
"""With which verdict a monitor's output is on; one with `NEVER` does not run."""
OUTPUTS: Final = ("none", "stop", "out1", "out2", "out3")
"""What a monitor may drive."""
MONITOR_SETTINGS: Final = ("formula", "on", "output")
"""Settings of a monitor."""
_COMMAND_FIELDS: Final = frozenset(range(1, 8))
_MOST_ARGUMENTS: Final = 16
MOST_REASON: Final = 200
_RESULT_FIELDS: Final = frozenset(range(1, 9))
_MOST_PLACES: Final = 1000
_MOST_SETTINGS: Final = 16


class CommandName(StrEnum):
    """Commands."""

    CALIBRATE = "calibrate"
    SET = "set"
    RESET = "reset"
    MONITOR = "monitor"
    CHALLENGE = "challenge"


class Mode(StrEnum):
    """What a node sends: every sample, peaks only, or as much as the signal's change needs."""

    SAMPLES = "samples"
    PEAKS = "peaks"
    ADAPTIVE = "adaptive"


@dataclass(frozen=True, slots=True)
class Range:
    """What a setting may be.

    Attributes:
        least: Least value.
        most: Greatest value.
        help: What it is, with its unit.
    """

    least: float
    most: float
    help: str

    def check(self, field: str, value: object) -> float:
        """Check a number.

        Raises:
            CommandError: It is none, or out of range.
        """
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise CommandError(field, value, f"a number from {self.least:g} to {self.most:g}")
        if not self.least <= value <= self.most:
            raise CommandError(field, value, f"{self.least:g} to {self.most:g}")
        return float(value)


RANGES: Final = {
    "threshold": Range(1e-30, 1e30, "least prominence of a peak, in the channel's unit"),
    "gain": Range(1e-3, 1e3, "gain of the chain, as a factor"),
    "smoothing": Range(0.0, 0.99, "weight of the past in each sample, 0 for none"),
    "rate": Range(1e-3, 1e6, "samples in a second"),
}
"""Settings that are numbers; ``mode`` and ``adaptive`` are not."""

SETTINGS: Final = (*RANGES, "mode", "adaptive")

_CHOICES: Final = {"mode": tuple(Mode), "adaptive": SWITCH, "on": ON, "output": OUTPUTS}

_ALLOWED: Final = {
    CommandName.CALIBRATE: ("taxel",),
    CommandName.SET: (*SETTINGS, "taxel", "channel"),
    CommandName.RESET: (),
    CommandName.MONITOR: ("monitor", *MONITOR_SETTINGS),
    CommandName.CHALLENGE: ("nonce",),
}


def check_arguments(name: CommandName, arguments: Mapping[str, object]) -> Arguments:
    """Check a command's arguments.

    - ``calibrate``: a ``taxel``; none means all.
    - ``set``: a ``threshold`` with its ``channel``; or any of ``gain``, ``smoothing``, ``rate``,
      ``mode`` and ``adaptive``, of one ``taxel`` or of all.
    - ``reset``: nothing.
    - ``monitor``: a ``monitor``, and its ``formula``, with ``on`` (by default ``possible``) and
      ``output`` (by default ``none``); without a formula, ``on`` is ``never``: it is removed.
    - ``challenge``: a ``nonce``, which the node signs once its gesture key is entered.

    Returns:
        The arguments, their numbers as floats.

    Raises:
        CommandError: One is not allowed, or one is missing.
    """
    allowed = _ALLOWED[name]
    for field, value in arguments.items():
        if field not in allowed:
            raise CommandError(field, value, f"{name} takes {', '.join(allowed) or 'nothing'}")
    checked = {field: _check(field, value) for field, value in arguments.items()}
    if name is CommandName.SET:
        _require_fitting(checked)
    if name is CommandName.CHALLENGE and not checked:
        raise CommandError("nonce", None, "16 bytes in hexadecimal, new for each challenge")
    if name is CommandName.MONITOR:
        if "monitor" not in checked:
            raise CommandError("monitor", None, "the name of a monitor, such as grip")
        if "formula" in checked:
            checked.setdefault("on", ON[0])
            checked.setdefault("output", OUTPUTS[0])
        elif set(checked) - {"monitor", "on"} or checked.get("on", NEVER) != NEVER:
            raise CommandError("formula", None, "a formula; to remove the monitor, its name alone")
        else:
            checked["on"] = NEVER
        if ("formula" in checked) is (checked["on"] == NEVER):
            raise CommandError("on", NEVER, f"{NEVER} without a formula")
    return checked


def place_of(arguments: Mapping[str, Value]) -> str:
    """The place that a command's arguments speak of."""
    if "monitor" in arguments:
        return f"{MONITOR_PLACE}{arguments['monitor']}"
    return str(arguments.get("channel", arguments.get("taxel", WHOLE_NODE)))


def is_place(text: str) -> bool:
    """Whether a text is a place."""
    if text.startswith(MONITOR_PLACE):
        return TAXEL.fullmatch(text.removeprefix(MONITOR_PLACE)) is not None
    return (
        text in (WHOLE_NODE, KEY_PLACE)
        or (TAXEL.fullmatch(text) or CHANNEL.fullmatch(text)) is not None
    )


def _check(field: str, value: object) -> Value:
    if field in RANGES:
        return RANGES[field].check(field, value)
    if field in _CHOICES:
        if value not in _CHOICES[field]:
            raise CommandError(field, value, ", ".join(_CHOICES[field]))
        return str(value)
    if field == "nonce":
        if not isinstance(value, str) or NONCE.fullmatch(value) is None:
            raise CommandError(field, value, "16 bytes as 32 hexadecimal digits, a to f")
        return value
    if field == "formula":
        if not isinstance(value, str) or not value.isprintable() or not value.strip():
            raise CommandError(field, value, "a text on one line")
        if len(value) > MOST_FORMULA:
            raise CommandError(field, value[:40], f"at most {MOST_FORMULA} characters")
        return value
    pattern = CHANNEL if field == "channel" else TAXEL
    if not isinstance(value, str) or pattern.fullmatch(value) is None:
        example = {"channel": "t01.capacitance", "monitor": "grip"}.get(field, "t01")
        raise CommandError(field, value, f"a {field} such as {example}")
    return value


def _require_fitting(arguments: Arguments) -> None:
    """A threshold has its channel's unit; everything else belongs to a taxel as a whole."""
    settings = [field for field in arguments if field in SETTINGS]
    if not settings:
        raise CommandError(
            "arguments", arguments, f"set takes at least one of {', '.join(SETTINGS)}"
        )
    if "threshold" in arguments:
        if "channel" not in arguments:
            raise CommandError("channel", None, "the threshold's channel, such as t01.capacitance")
        if set(arguments) != {"threshold", "channel"}:
            other = min(set(arguments) - {"threshold", "channel"})
            raise CommandError(other, arguments[other], "a threshold comes with its channel alone")
    elif "channel" in arguments:
        raise CommandError(
            "channel", arguments["channel"], f"{settings[0]} is of a taxel, or of the whole node"
        )


@dataclass(frozen=True, slots=True)
class Command:
    """A request to a node, carried out at most once.

    Attributes:
        id: Greater than those of all commands before to the same node; from 1 on.
        node: The node.
        issued: When, by the cloud's clock, UTC ns.
        expires: From then on the node rejects it, UTC ns.
        name: What to do.
        arguments: As `check_arguments` allows.
    """

    id: int
    node: str
    issued: int
    expires: int
    name: CommandName
    arguments: Arguments

    def encode(self) -> bytes:
        """Write as CBOR."""
        return dump(
            {1: int(Kind.COMMAND), 2: self.id, 3: self.node, 4: self.issued, 5: self.expires}
            | {6: str(self.name), 7: sort_texts(self.arguments)}
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a command.

        Raises:
            MessageError: It is none.
        """
        # Cryptography comes with identities; importing this module must not need it.
        from eskin.identity.identity_kind import IdentityKind  # noqa: PLC0415

        fields = load(data)
        fields.only(_COMMAND_FIELDS)
        kind = fields.integer(1, 0, 255)
        if kind != Kind.COMMAND:
            raise MessageError(f"field 1 is {kind}; expected a command ({Kind.COMMAND:d})")
        try:
            node = IdentityKind.NODE.require_name(fields.text(3, 63))
            name = _name(fields.text(6, 16))
            arguments = read_texts(fields.raw(7), "field 7", _MOST_ARGUMENTS)
            return cls(
                id=fields.integer(2, 1, MOST_COUNT),
                node=node,
                issued=fields.integer(4, -MOST_INSTANT, MOST_INSTANT),
                expires=fields.integer(5, -MOST_INSTANT, MOST_INSTANT),
                name=name,
                arguments=check_arguments(name, arguments),
            )
        except (CommandError, IdentityError) as error:
            raise MessageError(str(error)) from error


def _name(text: str) -> CommandName:
    if text not in CommandName.__members__.values():
        raise MessageError(f"field 6 is {text!r}; allowed: {', '.join(CommandName)}")
    return CommandName(text)


class Outcome(IntEnum):
    """What became of a command."""

    DONE = 0
    REFUSED = 1
    EXPIRED = 2


@dataclass(frozen=True, slots=True)
class Result:
    """A node's answer to a command. At each start it says the last one again, with its state.

    Attributes:
        position: Boot and sequence.
        time: Enclosure of the instant, UTC ns.
        command: Id of the last command that the node took; 0 if there never was one.
        outcome: What became of it.
        reason: Why it was not done; ``None`` if it was.
        state: How the node is set now.
    """

    position: Position
    time: tuple[int, int]
    command: int
    outcome: Outcome
    reason: str | None
    state: State

    def encode(self) -> bytes:
        """Write as CBOR."""
        state = sort_texts({place: sort_texts(found) for place, found in self.state.items()})
        reason: dict[int, object] = {} if self.reason is None else {7: self.reason}
        return dump(
            position_fields(Kind.RESULT, self.position)
            | {4: list(self.time), 5: self.command, 6: int(self.outcome), 8: state}
            | reason
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a result.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a result from its decoded fields."""
        fields.only(_RESULT_FIELDS)
        outcome = Outcome(fields.integer(6, 0, len(Outcome) - 1))
        if fields.has(7) is (outcome is Outcome.DONE):
            raise MessageError("field 7, the reason, stands where a command was not done")
        return cls(
            position=read_position(fields),
            time=fields.instants(4),
            command=fields.integer(5, 0, MOST_COUNT),
            outcome=outcome,
            reason=fields.text(7, MOST_REASON) if fields.has(7) else None,
            state=read_state(fields.raw(8)),
        )


def read_state(value: object) -> State:
    """Read the settings of each place.

    Raises:
        MessageError: It is no such map.
    """
    places = read_map(value, "field 8", _MOST_PLACES)
    for place in places:
        if not is_place(place):
            raise MessageError(
                f"field 8 speaks of {place!r}; expected a taxel, a channel, a monitor or *"
            )
    return {
        place: read_texts(found, f"field 8, {place}", _MOST_SETTINGS)
        for place, found in places.items()
    }
