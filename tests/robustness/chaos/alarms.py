"""Alarms under faults: each episode of the whole record raised one, each change was delivered."""

from __future__ import annotations

import json
import time
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

from eskin_cloud.alarms.episodes import Episodes, VerdictStretch
from eskin_cloud.query.channel_runs import ChannelSource
from eskin_cloud.query.formula_channels import channel_places, parse_formula
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.store import Store
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.write.monitors import MonitorDefinition, put_monitor

from eskin.errors import StoreError
from tests.support.alarm_receiver import read_taken
from tests.support.stores import ask_store

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation
    from sqlalchemy import Connection

    from tests.support.alarm_receiver import Taken

MONITORS: Final = {
    "beat": '"palm/t01.energy" > 6 pJ',
    "held": 'once[0,50ms] "fingertip/t01.capacitance" > 90 pF',
    "both": '"palm/t01.energy" > 6 pJ and "fingertip/t01.capacitance" > 60 pF',
    "never": '"palm/t01.energy" < 0 pJ',
}
PATIENCE_S: Final = 60.0
RAISED_WITHIN_S: Final = 30.0
"""Once all frames have arrived, all alarms are raised so soon, however long the faults lasted."""


class Episode(NamedTuple):
    """From and until when, in ticks; ``None`` while it goes on."""

    began: int
    ended: int | None

    def meets(self, other: Episode) -> bool:
        """Whether they have an instant in common."""
        before = self.ended is None or other.began < self.ended
        return before and (other.ended is None or self.began < other.ended)


def define(store: StoreLocation) -> None:
    """Define the monitors beside the running cloud."""

    def work(connection: Connection) -> None:
        for name, formula in MONITORS.items():
            definition = MonitorDefinition(
                formula,
                None,
                "certain",
                missing=False,
                severity="warning",
                clear_after=0,
                escalate_after=None,
            )
            put_monitor(connection, name, definition, now=time.time_ns())

    with Store(store) as opened:
        opened.write(work).result(60)


def judge_alarms(store: StoreLocation, taken: Path) -> tuple[int, int, list[str]]:
    """How many alarms and deliveries there are, and what is wrong once all is delivered.

    A receiver that fails as often as ours takes some four changes a second, and long plans make
    more. So it is waited for as long as it takes any. Alarms are not waited for: those that are
    wrong after `RAISED_WITHIN_S` stay wrong.
    """
    begun, late = time.monotonic(), list[str]()
    deadline, before = begun + PATIENCE_S, 0
    while True:
        looked = time.monotonic() - begun
        try:
            with Store(store) as opened:
                wrong = [each for name in MONITORS for each in _episodes_wrong(opened, name)]
            if wrong and not late and looked > RAISED_WITHIN_S:
                late = [f"{looked:.0f} s after all had arrived: {each}" for each in wrong]
        except StoreError as error:  # a cloud stores many alarms at once
            wrong = [f"alarms cannot be read: {error}"]
        given = read_taken(taken)
        if len(given) > before:
            deadline, before = time.monotonic() + PATIENCE_S, len(given)
        wrong += deliveries_wrong(_transitions(store), given)
        if not wrong or time.monotonic() > deadline:
            count = ask_store(store, "SELECT count(*) FROM alarms")[0][0]
            return int(count), len(given), late + wrong
        time.sleep(2.0)


def _transitions(store: StoreLocation) -> list[tuple[int, str, int | None, int]]:
    query = "SELECT number, kind, alarm, silenced FROM alarm_transitions ORDER BY number"
    return [(row[0], row[1], row[2], row[3]) for row in ask_store(store, query)]


def deliveries_wrong(
    stored: Sequence[tuple[int, str, int | None, int]], given: Sequence[Taken]
) -> list[str]:
    """What of the deliveries is wrong.

    Args:
        stored: Number, kind, alarm and whether it is silenced, of each transition.
        given: What the receiver took.
    """
    wrong = []
    wanted = {number: kind for number, kind, _, silenced in stored if not silenced}
    first: dict[int, tuple[str, str]] = {}
    for key, document in given:
        said = key, json.dumps(document, sort_keys=True)
        if first.setdefault(document["number"], said) != said:
            wrong.append(f"change {document['number']} was delivered with another key or text")
    if list(first) != sorted(first):
        wrong.append("changes were not delivered in their order")
    if missing := wanted.keys() - first.keys():
        wrong.append(f"{len(missing)} changes were not delivered, the first is {min(missing)}")
    if more := first.keys() - wanted.keys():
        wrong.append(f"{len(more)} changes were delivered that are not stored, such as {min(more)}")
    if len({key for key, _ in first.values()}) < len(first):
        wrong.append("two changes have one key")
    return wrong + _lives_wrong(stored)


def _lives_wrong(stored: Sequence[tuple[int, str, int | None, int]]) -> list[str]:
    kinds: dict[int, list[str]] = {}
    for _, kind, alarm, _ in stored:
        if alarm is not None:
            kinds.setdefault(alarm, []).append(kind)
    return [
        f"alarm {alarm} was {', '.join(found)}"
        for alarm, found in kinds.items()
        if found not in (["raised"], ["raised", "cleared"])
    ]


def _episodes_wrong(store: Store, name: str) -> list[str]:
    """What of a monitor's alarms is not as in the whole record."""
    query = f"SELECT began, ended FROM alarms WHERE monitor = '{name}' ORDER BY began"  # noqa: S608 - our words
    raised = [Episode(*row) for row in ask_store(store.location, query)]
    with store.read() as connection:
        wanted, end = _whole_record(connection, store, name)
    return episodes_wrong(name, raised, wanted, end)


def _whole_record(connection: Connection, store: Store, name: str) -> tuple[list[Episode], int]:
    """The episodes of a monitor's whole record, and the instant up to which it is known."""
    formula = parse_formula(MONITORS[name])
    since = ask_store(store.location, f"SELECT changed FROM monitors WHERE name = '{name}'")[0][0]  # noqa: S608 - our words
    sources = {
        channel: ChannelSource(connection, find_channel(connection, *place))
        for channel, place in channel_places(formula, None).items()
    }
    end = min(source.channel["t_last"] for source in sources.values())
    episodes = Episodes(on_possible=False, missing=False, clear_after=0, is_open=False)
    found: list[Episode] = []
    pieces = StoredVerdicts(formula, sources, most_reads=10**6).pieces(Window(since, end))
    for edge in episodes.add(VerdictStretch(p.first, p.last, p.verdict, p.missing) for p in pieces):
        if edge.verdict is not None:
            found.append(Episode(edge.tick, None))
        else:
            found[-1] = Episode(found[-1].began, edge.tick)
    return found, 2 * end


def episodes_wrong(
    name: str, raised: Sequence[Episode], wanted: Iterable[Episode], end: int
) -> list[str]:
    """What is wrong with the alarms of a monitor.

    Args:
        name: The monitor's.
        raised: Its alarms.
        wanted: The episodes of the whole record.
        end: The tick up to which that is known.
    """
    wanted = list(wanted)
    wrong = [
        f"{name}: no alarm for the episode of {each}"
        for each in wanted
        if each.ended is not None and not any(each.meets(alarm) for alarm in raised)
    ]
    wrong += [
        f"{name}: an alarm for {alarm}, where nothing holds"
        for alarm in raised
        if alarm.began < end and not any(alarm.meets(each) for each in wanted)
    ]
    wrong += [
        f"{name}: two alarms for one time, {one} and {other}"
        for one, other in pairwise(raised)
        if one.meets(other)
    ]
    return wrong
