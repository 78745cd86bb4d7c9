"""A plan is drawn from its seed alone, and fits."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.robustness.chaos.faults import (
    DATABASE,
    FAULTS,
    MEMBER,
    MEMBERS,
    TIMED,
    WORKER,
    WORKERS,
)
from tests.robustness.chaos.plan import make_plan
from tests.support.patroni import DYNAMIC

PARTS = ("broker", "cloud", "gateway-1", "gateway-2", "fingertip", DATABASE)
SEEDS = st.integers(0, 2**32)


@settings(deadline=None)
@given(seed=SEEDS, seconds=st.floats(1.0, 600.0))
def test_plan_fits(seed: int, seconds: float) -> None:
    plan = make_plan(seed, seconds=seconds, parts=PARTS)
    assert plan == make_plan(seed, seconds=seconds, parts=PARTS)
    assert all(stroke.fault in FAULTS for stroke in plan)
    assert all(0.0 <= stroke.begin < stroke.end <= seconds for stroke in plan)
    for part in PARTS:
        own = sorted((s.begin, s.end) for s in plan if s.part == part)
        assert all(before[1] < after[0] for before, after in pairwise(own)), own


def test_every_fault_is_in_a_long_plan() -> None:
    plan = make_plan(1, seconds=600.0, parts=PARTS)
    assert {stroke.fault for stroke in plan} == set(FAULTS) - {*MEMBER, "move shard"}
    assert {stroke.part for stroke in plan} == set(PARTS)
    assert any(a.end > b.begin for a, b in pairwise(plan)), "none overlap"


def test_another_seed_is_another_plan() -> None:
    assert make_plan(1, seconds=60.0, parts=PARTS) != make_plan(2, seconds=60.0, parts=PARTS)


def test_database_befalls_all_that_can_and_its_clock_stays() -> None:
    plan = make_plan(1, seconds=600.0, parts=PARTS)
    befell = {stroke.fault for stroke in plan if stroke.part == DATABASE}
    assert befell >= {"kill", "hang", "disk full", "cut", "reset", "renewal"}
    assert befell.isdisjoint(TIMED)
    assert any(stroke.part == DATABASE for stroke in make_plan(2, seconds=10.0, parts=PARTS))


def test_member_of_a_cluster_is_away_for_a_promotion_and_befalls_all_that_can() -> None:
    parts = [*PARTS[:-1], *MEMBERS]
    plan = make_plan(1, seconds=600.0, parts=parts)
    ttl = DYNAMIC["ttl"]
    assert isinstance(ttl, int)
    kills = [s for s in plan if (s.fault, s.part) == ("kill", MEMBERS[0])]
    assert kills[0].end - kills[0].begin > ttl
    for member in MEMBERS:
        befell = {stroke.fault for stroke in plan if stroke.part == member}
        assert befell >= {*MEMBER, "kill", "cut", "renewal"}
        assert befell.isdisjoint(TIMED)


def test_worker_of_citus_befalls_what_needs_no_network() -> None:
    parts = [*PARTS, *WORKERS]
    plan = make_plan(1, seconds=600.0, parts=parts)
    for worker in WORKERS:
        befell = [stroke.fault for stroke in plan if stroke.part == worker]
        assert set(befell) == set(WORKER)
        assert befell.count("kill") > 3
        assert befell.count("move shard") > 3
    short = make_plan(2, seconds=15.0, parts=parts)
    assert {("kill", WORKERS[0]), ("move shard", WORKERS[-1])} <= {
        (stroke.fault, stroke.part) for stroke in short
    }


def test_plan_without_a_database_spares_it() -> None:
    others = [part for part in PARTS if part != DATABASE]
    assert all(stroke.part in others for stroke in make_plan(1, seconds=60.0, parts=others))
