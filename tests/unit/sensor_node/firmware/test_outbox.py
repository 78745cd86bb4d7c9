"""An outbox in all that may happen to it, against what a gateway may expect of it."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.gap_reasons import FAILED, FULL, TEXTS
from eskin_sensor_node.firmware.message_writer import STATEMENTS
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from eskin.wire.frames import Statements
from tests.contract.micropython.delivery import Delivery

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.chip import Position, StoredMessage

    from eskin.wire.frames import Gap

CAPACITY = 9000
PATIENCE = 20
ALL = 100_000
LAYOUT = "5a" * 32


SAID = st.lists(
    st.one_of(
        st.tuples(st.just("frame"), st.integers(1, 1000)),
        st.tuples(st.sampled_from(["statements", "status"]), st.just(0)),
    ),
    min_size=1,
    max_size=12,
)


class Life(RuleBasedStateMachine):
    """A node's life, with what it said, and what a gateway has got and acknowledged."""

    def __init__(self) -> None:
        super().__init__()
        self.node = Delivery(CAPACITY, 16, PATIENCE, 200, LAYOUT)
        self.frames: set[Position] = set()
        self.events: set[Position] = set()
        self.given_up: set[Position] = set()
        self.failed: set[Position] = set()
        self.arrived: set[Position] = set()
        self.forgotten: dict[Position, StoredMessage] = {}
        self.with_radio: set[Position] = set()
        self.on_air: dict[Position, int] = {}

    def waiting(self) -> dict[Position, StoredMessage]:
        return {kept.position: kept for kept in self.node.chip.after((-1, -1), ALL)}

    def named(self, reason: str) -> Counter[Position]:
        """How many gaps name a position, of those that wait or that a gateway has."""
        found: Counter[Position] = Counter()
        for kept in [*self.waiting().values(), *self.forgotten.values()]:
            for gap in self.gaps(kept):
                if gap.reason == reason:
                    spans = gap.lost
                    found.update((b, n) for b, first, last in spans for n in range(first, last + 1))
        return found

    def gaps(self, kept: StoredMessage) -> Sequence[Gap]:
        """The gaps that a message states."""
        return Statements.decode(kept.body).gaps if kept.kind == STATEMENTS else ()

    @rule(data=st.data())
    def say(self, data: st.DataObject) -> None:
        said = data.draw(SAID)
        numbers = self.node.say(*said)
        assert numbers is not None
        # A gap comes first where something failed before.
        own = numbers[len(numbers) - len(said) :]
        for number, (kind, _) in zip(own, said, strict=True):
            (self.frames if kind == "frame" else self.events).add((self.node.outbox.boot, number))
        self.check_losses()

    def check_losses(self) -> None:
        waiting, full, failed = self.waiting(), self.named(TEXTS[FULL]), self.named(TEXTS[FAILED])
        there = waiting.keys() | self.forgotten.keys()
        lost = (self.frames | self.events) - there
        assert full == Counter(lost), "each loss is named by one gap, and nothing else is"
        assert not failed.keys() & there
        assert failed.keys() >= self.failed
        assert set(failed.values()) <= {1}
        assert not failed.keys() & full.keys()
        frames = self.frames & waiting.keys()
        if lost and frames:
            assert lost & self.events == self.given_up, "peaks outlive frames"
            assert max(lost & self.frames) < min(frames), "the oldest frames give way first"
        self.given_up = lost & self.events
        assert self.node.outbox.usage()[:2] == (
            len(waiting),
            sum(len(k.body) for k in waiting.values()),
        )
        assert self.node.outbox.usage()[1] <= CAPACITY

    @rule(data=st.data())
    def fail_to_say(self, data: st.DataObject) -> None:
        said = data.draw(SAID)
        first = self.node.outbox._sequence
        self.node.wear_out()
        assert self.node.say(*said) is None
        self.node.repair()
        boot = self.node.outbox.boot
        self.failed |= {(boot, n) for n in range(first, self.node.outbox._sequence)}

    @rule(time=st.integers(1, 60))
    def wait(self, time: int) -> None:
        self.node.wait(time)

    @rule()
    def connect(self) -> None:
        self.node.connect()
        self.with_radio.clear()
        self.on_air.clear()

    @rule(most=st.integers(1, 20))
    def send(self, most: int) -> None:
        sent = [(each[0][0], each[0][1]) for each in self.node.send(most)]
        assert set(sent) <= self.waiting().keys(), "nothing that was acknowledged, or gave way"
        for position in sent:
            assert position not in self.with_radio
            left = self.on_air.pop(position, None)
            assert left is None or self.node.now - left > PATIENCE
        self.with_radio |= set(sent)
        self.arrived |= set(sent)
        if len(sent) < most:
            late = {p for p, left in self.on_air.items() if self.node.now - left > PATIENCE}
            assert not late & self.waiting().keys(), "what is late goes out again"
            under_way = self.with_radio | self.on_air.keys()
            assert self.waiting().keys() <= under_way or len(under_way) >= 16

    @rule(step=st.integers(1, 3))
    def leave(self, step: int) -> None:
        for position in sorted(self.with_radio)[::step]:
            self.node.leave(position[0], position[1], position[1])
            self.with_radio.remove(position)
            self.on_air[position] = self.node.now

    @rule()
    def hear_nothing(self) -> None:
        self.leave(1)
        self.wait(PATIENCE + 1)
        self.send(20)

    @precondition(lambda self: self.arrived)
    @rule(data=st.data(), broken=st.booleans())
    def acknowledge(self, data: st.DataObject, broken: bool) -> None:  # noqa: FBT001
        chosen = data.draw(st.sets(st.sampled_from(sorted(self.arrived))))
        spans = [(boot, number, number) for boot, number in sorted(chosen)]
        before = self.waiting()
        if broken:
            self.node.wear_out()
        assert self.node.acknowledge(*spans) is not broken
        if broken:
            self.node.repair()
            assert self.waiting().keys() == before.keys()
            return
        self.forgotten |= {p: before[p] for p in chosen & before.keys()}
        self.with_radio -= chosen
        for position in chosen:
            self.on_air.pop(position, None)

    @rule()
    def lose_power(self) -> None:
        # What failed at the end of a boot is not reported: no number behind it was ever used.
        self.failed &= self.named(TEXTS[FAILED]).keys()
        self.node.restart()
        self.with_radio.clear()
        self.on_air.clear()

    def teardown(self) -> None:
        """In the end, all arrives that did not give way, and nothing stays."""
        self.connect()
        while self.waiting():
            held = self.node.outbox.held()
            assert held == min(self.waiting())
            self.send(16)
            self.leave(1)
            gone = self.with_radio | self.on_air.keys()
            self.node.acknowledge(*[(boot, number, number) for boot, number in sorted(gone)])
            self.with_radio.clear()
            self.on_air.clear()
            assert self.node.outbox.held() > held
        assert self.node.outbox.usage()[:2] == (0, 0)


Life.TestCase.settings = settings(max_examples=60, stateful_step_count=50, deadline=None)
test_life = Life.TestCase
