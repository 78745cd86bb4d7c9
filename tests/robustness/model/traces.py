"""Traces: what became of messages, as TLC checks it against the model."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Final, NamedTuple

from tests.robustness.model.bounds import INVARIANTS
from tests.robustness.model.tlc import MODULES, Result, check

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

WINDOW: Final = 4
"""Messages of a window; what becomes of one depends on few others: cut-offs and spans."""
MOST_WINDOWS: Final = 500
_RANKS: Final = ("made", "spooled", "stored", "settled", "freed", "evicted", "cut")
"""Of events at one millisecond: none is the cause of one before it."""


class Event(NamedTuple):
    """A durable change.

    Attributes:
        time: When its statement was executed, seconds; before its commit, and so before all that
            follows from the commit.
        what: ``made``, ``freed`` or ``evicted`` in a flash; ``spooled`` or ``settled`` in a spool;
            ``stored``; or ``cut``: the gateway's cut-off is this position.
        node: The node.
        boot: Its boot.
        sequence: The number.
        gateway: Whose spool; empty elsewhere.
    """

    time: float
    what: str
    node: str
    boot: int
    sequence: int
    gateway: str = ""


def windows(events: Iterable[Event], *, size: int = WINDOW) -> list[list[Event]]:
    """Events of a few consecutive messages each, in order, with numbers of their own from 0.

    Messages whose making was not recorded are left out.
    """
    by_node: dict[str, list[Event]] = defaultdict(list)
    for event in sorted(events, key=lambda each: (each.time, _RANKS.index(each.what))):
        by_node[event.node].append(event)
    found: list[list[Event]] = []
    for mine in by_node.values():
        made = sorted({each[3:5] for each in mine if each.what == "made"})
        found += [_window(mine, made[at : at + size]) for at in range(0, len(made), size)]
    return found


def _window(events: Sequence[Event], messages: Sequence[tuple[int, int]]) -> list[Event]:
    boots = {boot: n for n, boot in enumerate(sorted({boot for boot, _ in messages}), start=1)}
    numbers = {
        (boot, sequence): sum(1 for other in messages if other[0] == boot and other[1] < sequence)
        for boot, sequence in messages
    }
    window: list[Event] = []
    cuts: dict[tuple[str, int], int] = {}
    for event in events:
        if event.what == "cut":
            below = sum(1 for m in messages if m[0] == event.boot and m[1] < event.sequence)
            if not below or cuts.get((event.gateway, event.boot)) == below:
                continue
            cuts[event.gateway, event.boot] = below
            window.append(event._replace(boot=boots[event.boot], sequence=below))
        elif (number := numbers.get((event.boot, event.sequence))) is not None:
            window.append(event._replace(boot=boots[event.boot], sequence=number))
    return window


def vanished(events: Iterable[Event]) -> list[tuple[str, int, int]]:
    """Node, boot and number of what was made in a flash, and is neither stored nor stated as lost.

    To be asked when everything has arrived. It does not rely on what nodes or the audit say of
    their last frames before a kill.
    """
    found: dict[str, set[tuple[str, int, int]]] = defaultdict(set)
    for each in events:
        found[each.what].add((each.node, each.boot, each.sequence))
    return sorted(found["made"] - found["stored"] - found["evicted"])


def pick(found: Sequence[list[Event]], most: int = MOST_WINDOWS) -> list[list[Event]]:
    """The windows with most events: what was sent again, taken over or stored late."""
    return sorted(found, key=len, reverse=True)[:most]


def check_windows(found: Sequence[Sequence[Event]], *, seconds: float = 300.0) -> Result:
    """Let TLC check windows against the model.

    A window that is no behaviour of the model is a ``deadlock``, at its first inexplicable event.

    Raises:
        TlcError: TLC failed.
    """
    gateways = sorted({each.gateway for window in found for each in window if each.gateway})
    text = ",\n".join(
        "<<" + ", ".join(
            f'<<"{each.what}", "{each.gateway}", {each.boot}, {each.sequence}>>' for each in window
        ) + ">>"
        for window in found
    )  # fmt: skip
    modules = {name: (MODULES / f"{name}.tla").read_text() for name in ("Delivery", "Trace")}
    modules["Windows"] = f"---- MODULE Windows ----\nWindows == <<\n{text}\n>>\n====\n"
    size = max((len(window) for window in found), default=0)
    return check(
        modules,
        "Trace",
        [
            "SPECIFICATION TraceSpec",
            "CONSTANTS",
            "Nodes = {0}",
            f"Gateways = {{{', '.join(map(_quote, gateways or ['none']))}}}",
            "Clouds = {cloud}",
            "Slots = 1",
            f"Boots = {max((e.boot for w in found for e in w), default=1)}",
            f"Sequences = {1 + max((e.sequence for w in found for e in w), default=0)}",
            "Worn = {}",
            f"MostNamed = {size}",
            "MostBatch = 1",
            "Loaded = FALSE",
            "Whole = FALSE",
            "None = None",
            f"INVARIANTS {' '.join(INVARIANTS)}",
        ],
        deadlock=True,
        seconds=seconds,
    )


def _quote(name: str) -> str:
    return f'"{name}"'
