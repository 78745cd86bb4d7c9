"""Whatever comes in whatever order, each message is stored once, and none is lost."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from eskin_cloud.store.schema.frame_tables import descriptions, frames, pages
from eskin_cloud.store.schema.tables import dead_letters, events, nodes, sequences
from eskin_cloud.store.write.ingest import DUPLICATE, REJECTED, STORED, UNKNOWN_LAYOUT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.wire.frames import Frame, Statements
from tests.support.examples import examples
from tests.unit.cloud.clouds import emptied
from tests.unit.cloud.skins import (
    HAND,
    PALM,
    PATCHES,
    TIP,
    WARM,
    bring_all,
    describe,
    frame,
    layout,
    patch,
    statements,
)
from tests.unit.cloud.test_frames import rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_cloud.store import Store

    from eskin.wire.frames import Layout, Patch

EXTRA: Final = patch("extra", 2)
OTHER: Final = layout((PALM, WARM, TIP, EXTRA), (2, 1, 1))
LAYOUTS: Final = {each.content_hash: each for each in (HAND, OTHER)}
DESCRIPTIONS: Final[tuple[Layout | Patch, ...]] = (HAND, OTHER, *PATCHES, EXTRA)
NODES: Final = ("left", "right")


class Said(NamedTuple):
    """A message, and of which node."""

    node: str
    message: Frame | Statements

    @property
    def key(self) -> tuple[str, int, int]:
        return self.node, *self.message.position

    @property
    def needs(self) -> set[bytes]:
        """What it is read by."""
        return {self.message.layout, *LAYOUTS[self.message.layout].patches}


@st.composite
def said(draw: st.DrawFn) -> Said:
    """One of few numbers, so that many are the same or collide."""
    sequence, boot = draw(st.integers(0, 7)), draw(st.integers(1, 2))
    seed = draw(st.sampled_from((0, 0, 0, 1)))
    of = HAND if (sequence + boot + seed) % 3 else OTHER
    kind = (sequence + seed) % 4
    message: Frame | Statements
    if kind == 3:
        message = statements(sequence, boot=boot, of=of, seed=seed)
    else:
        message = frame(sequence, boot=boot, of=of, page=kind % 2, seed=seed, at=sequence * 10**9)
    return Said(draw(st.sampled_from(NODES)), message)


STEPS: Final = st.lists(
    st.one_of(
        st.tuples(
            st.sampled_from(NODES), st.lists(st.sampled_from(DESCRIPTIONS), min_size=1, max_size=6)
        ),
        st.lists(said(), min_size=1, max_size=12),
        st.just("restart"),
    ),
    max_size=12,
)


class Model:
    """What a store must hold."""

    def __init__(self) -> None:
        self.known: dict[str, set[bytes]] = defaultdict(set)
        self.stored: dict[tuple[str, int, int], Said] = {}
        self.conflicts: Counter[tuple[str, bytes]] = Counter()

    def expect(self, each: Said) -> str:
        """What becomes of a message, which is taken."""
        if each.needs - self.known[each.node]:
            return UNKNOWN_LAYOUT
        standing = self.stored.get(each.key)
        if standing is None:
            self.stored[each.key] = each
            return STORED
        if standing.message.encode() == each.message.encode():
            return DUPLICATE
        self.conflicts[each.node, each.message.encode()] += 1
        return REJECTED


def bring(store: Store, model: Model, batch: Sequence[Said]) -> None:
    outcome = bring_all(store, *batch)
    for each, receipt in zip(batch, outcome.results, strict=True):
        missing = each.needs - model.known[each.node]
        assert receipt.result == model.expect(each)
        assert set(receipt.want) <= missing
        assert bool(receipt.want) is bool(missing)
    assert len(outcome.results) == len(batch)


def present(store: Store, model: Model, node: str, some: Sequence[Layout | Patch]) -> None:
    for each, result in zip(some, describe(store, *some, node=node), strict=True):
        fresh = each.content_hash not in model.known[node]
        assert result.result == (STORED if fresh else DUPLICATE)
    model.known[node] |= {each.content_hash for each in some}


@settings(
    deadline=None,
    max_examples=examples(40),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(steps=STEPS)
def test_each_is_stored_once_and_none_is_lost(store: Store, steps: list[Any]) -> None:
    emptied(store)
    store.clear_caches()
    model, everything = Model(), list[Said]()
    for step in steps:
        if step == "restart":
            store.clear_caches()
            check(store, model)
        elif isinstance(step, tuple):
            present(store, model, *step)
        else:
            everything += step
            bring(store, model, step)
    for node in NODES:
        present(store, model, node, DESCRIPTIONS)
    if everything:
        bring(store, model, everything)  # a gateway sends again what was not stored
    assert {each.key for each in everything} == set(model.stored)
    check(store, model)


def check(store: Store, model: Model) -> None:
    """Compare every table with what came."""
    of_frames = {key: each for key, each in model.stored.items() if isinstance(each.message, Frame)}
    found = {(row["node"], row["boot"], row["sequence"]): row for row in rows(store, frames)}
    assert {key: row["data"] for key, row in found.items()} == {
        key: each.message.encode() for key, each in of_frames.items()
    }
    totals: Counter[tuple[str, bytes, int]] = Counter()
    for key, each in of_frames.items():
        assert isinstance(each.message, Frame)
        row = found[key]
        assert row["samples"] == sum(values.inf.size for values in each.message.values)
        totals[each.node, each.message.layout, each.message.page] += row["samples"]
    assert totals == Counter({
        (row["node"], row["layout"], row["page"]): row["samples"] for row in rows(store, pages)
    })  # fmt: skip
    kinds = Counter((row["node"], row["boot"], row["sequence"], row["kind"])
                    for row in rows(store, events))  # fmt: skip
    for key, each in model.stored.items():
        if isinstance(each.message, Statements):
            assert (kinds[*key, "peak"], kinds[*key, "gap"]) == (1, 1)
    assert sum(kinds[each] for each in kinds if each[3] in {"peak", "gap"}) == 2 * sum(
        isinstance(each.message, Statements) for each in model.stored.values()
    )
    assert sum(kinds[each] for each in kinds if each[3] == "conflict") == sum(
        model.conflicts.values()
    )
    ranges = {
        (row["node"], row["boot"], number)
        for row in rows(store, sequences)
        for number in range(row["first"], row["last"] + 1)
    }
    assert ranges == set(model.stored)
    assert {(row["node"], row["data"]) for row in rows(store, dead_letters)} == set(model.conflicts)
    assert {(row["node"], row["hash"]) for row in rows(store, descriptions)} == {
        (node, name) for node, names in model.known.items() for name in names
    }
    assert {row["node"] for row in rows(store, nodes)} == {key[0] for key in model.stored}
    cursors = [row["cursor"] for table in (frames, events) for row in rows(store, table)]
    assert len(set(cursors)) == len(cursors)
