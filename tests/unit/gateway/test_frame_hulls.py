"""Public hulls of frames: at most twice a second, and no value is lost from them."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson
import pytest
from eskin_gateway.publish import public_payloads
from eskin_gateway.publish.frame_hulls import LARGE as FROM
from eskin_gateway.publish.frame_hulls import HullCollector
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire.frames import DescribedLayout, EncodedFrame
from eskin.wire.timestamp import format_timestamp
from tests.unit.eskin.senml import read_senml
from tests.unit.gateway.messages import EPOCH
from tests.unit.gateway.skins import LARGE, PERIOD, SMALL, SkinOf, patch

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin_gateway.publish.frame_hulls import PublishedHull

    from eskin.wire.frames import Frame


def joined(skin: SkinOf) -> DescribedLayout:
    return DescribedLayout.of(skin.layout, skin.patches)


class Published:
    """What `HullCollector` publishes, with the time of each.

    Attributes:
        items: Time, topic and JSON of each.
    """

    def __init__(self, skin: SkinOf, *, senml: bool = False) -> None:
        self.hulls = HullCollector()
        self._senml = senml
        self.skin = joined(skin)
        self.items: list[tuple[float, str, Any]] = []

    def add(self, frame: Frame, now: float) -> None:
        self.add_of("n", frame, self.skin, now)

    def add_of(self, node: str, frame: Frame, skin: DescribedLayout, now: float) -> None:
        data = frame.encode()
        found = self.hulls.add(node, EncodedFrame.decode(data), skin, now=now)
        self._take(now, found)

    def run_periodic(self, now: float) -> None:
        self._take(now, self.hulls.run_periodic(now))

    def _take(self, now: float, due: Iterable[tuple[str, PublishedHull]]) -> None:
        for node, hull in due:
            for topic, body, retained in public_payloads.hulls(node, hull, senml=self._senml):
                assert not retained
                self.items.append((now, topic.removeprefix("eskin/v1/"), orjson.loads(body)))

    def on(self, topic: str) -> list[Any]:
        return [item for _, at, item in self.items if at == topic]

    @property
    def topics(self) -> set[str]:
        return {topic for _, topic, _ in self.items}


def instant(text: str) -> int:
    whole, _, rest = text.removesuffix("Z").partition(".")
    return int(np.datetime64(whole, "s").astype(int)) * 10**9 + int(rest.ljust(9, "0"))


def test_channels_of_a_small_skin_are_published() -> None:
    published = Published(SMALL)
    values = {
        0: np.arange(15.0).reshape(5, 3) * 8,
        1: np.array([[-64.0, 5e5]] * 5),
    }
    published.add(SMALL.frame(1, values, coverage=0.999), 10.0)
    assert published.topics == {
        "live/n/p000c00.pressure", "live/n/p000c01.pressure", "live/n/p000c02.pressure",
        "live/n/p001c00.pressure", "live/n/p001c01.pressure",
    }  # fmt: skip
    start = EPOCH + 5 * PERIOD
    (item,) = published.on("live/n/p000c01.pressure")
    coverage = item.pop("coverage")
    assert item == {
        "t0": format_timestamp(start),
        "t1": format_timestamp(start + 500 + 4 * PERIOD),
        "lo": 8.0,
        "hi": 8.0 * 13 + 100.0,
        "unit": "Pa",
        "n": 5,
    }
    assert 0.0 <= 1 - 5 * (1 - Fraction(0.999)) - Fraction(coverage) < 1e-12


def test_patches_of_a_large_skin_are_published_and_not_its_channels() -> None:
    assert sum(len(each.taxels) for each in LARGE.patches) >= FROM
    published = Published(LARGE)
    lo = 2000.0 + 128.0 * np.arange(20.0)
    published.add(LARGE.frame(3, {0: lo, 1: lo + 64.0}), 10.0)
    assert published.topics == {"live/n/patches/pad000", "live/n/patches/pad001"}
    (item,) = published.on("live/n/patches/pad000")
    assert item["taxels"] == list(LARGE.patches[0].taxels)
    assert item["lo"] == lo.tolist()
    assert item["hi"] == (lo + 100.0).tolist()
    assert item["hull"] == {"lo": lo[0], "hi": lo[-1] + 100.0, "coverage": 1.0}
    assert (item["unit"], item["coverage"], item["n"], item["contact"]) == ("Pa", 1.0, 5, "certain")
    assert instant(item["t0"]) == EPOCH + 15 * PERIOD
    assert instant(item["t1"]) == EPOCH + 15 * PERIOD + 500 + 4 * PERIOD


@pytest.mark.parametrize(
    ("lows", "threshold", "contact"),
    [
        ([[3100.0], [3001.0]], 3e3, "certain"),
        ([[3100.0], [3000.0]], 3e3, "possible"),
        ([[2800.0], [3100.0]], 3e3, "possible"),
        ([[2900.0], [2900.0]], 3e3, "impossible"),
        ([[2901.0], [2900.0]], 3e3, "possible"),
        ([[9000.0], [9000.0]], None, None),
    ],
)
def test_contact_is_a_verdict_on_all_samples(
    lows: list[list[float]], threshold: float | None, contact: str | None
) -> None:
    skin = SkinOf(*(patch(number, 32, threshold=threshold) for number in range(2)))
    values = np.full((2, 32), 5.0)
    values[:, :1] = lows
    published = Published(skin)
    published.add(skin.frame(1, {0: values, 1: values}, rows=2), 10.0)
    assert published.on("live/n/patches/pad000")[0]["contact"] == contact


def test_column_without_samples_is_unknown() -> None:
    skin = SkinOf(patch(0, 64))
    published = Published(skin)
    # Row 1 has samples of the columns with stride 0 only.
    published.add(skin.frame(1, rows=1, strides=bytes([0] * 63 + [4])), 10.0)
    (item,) = published.on("live/n/patches/pad000")
    assert (item["lo"][-1], item["hi"][-1], item["contact"]) == (None, None, "possible")
    assert (item["lo"][0], item["hi"][0]) == (1000.0, 1100.0)
    assert item["hull"]["lo"] is None
    small = SkinOf(patch(0, 2))
    published = Published(small)
    published.add(small.frame(1, rows=1, strides=bytes([0, 4])), 10.0)
    assert published.topics == {"live/n/p000c00.pressure"}


@given(
    steps=st.lists(st.tuples(st.floats(0.0, 0.4), st.floats(0.0, 1e6)), min_size=1, max_size=40),
    skin=st.sampled_from([SkinOf(patch(0, 2)), SkinOf(patch(0, 64))]),
)
def test_every_sample_is_in_a_hull_and_no_topic_has_more_than_two_a_second(
    steps: list[tuple[float, float]], skin: SkinOf
) -> None:
    published, now = Published(skin), 100.0
    for sequence, (step, value) in enumerate(steps):
        now += step
        published.run_periodic(now)
        published.add(skin.frame(sequence, {0: np.array(value)}, rows=1), now)
    for _ in range(12):
        now += 0.1
        published.run_periodic(now)
    is_large = len(skin.patches[0].taxels) == 64
    topic = "live/n/patches/pad000" if is_large else "live/n/p000c00.pressure"
    times = [at for at, on, _ in published.items if on == topic]
    assert all(later - at >= 0.5 - 1e-9 for at, later in pairwise(times))
    items = published.on(topic)
    assert sum(item["n"] for item in items) == len(steps)
    for sequence, (_, value) in enumerate(steps):
        sampled = EPOCH + sequence * PERIOD
        (item,) = (
            each for each in items if instant(each["t0"]) <= sampled <= instant(each["t1"]) - 500
        )
        lo, hi = (item["lo"][0], item["hi"][0]) if is_large else (item["lo"], item["hi"])
        assert lo <= value <= value + 100.0 <= hi


def test_hulls_of_nodes_and_of_changed_patches_stay_apart() -> None:
    published = Published(SMALL)
    wider = SkinOf(patch(0, 4))
    for node in "n", "m":
        for now in 1.0, 1.1:
            published.add_of(node, SMALL.frame(1), published.skin, now)
    assert len(published.on("live/n/p000c00.pressure")) == 1
    assert len(published.on("live/m/p000c00.pressure")) == 1
    # What was measured by the former layout is published by itself.
    published.add_of("n", wider.frame(2), joined(wider), 1.2)
    assert [item["n"] for item in published.on("live/n/p000c00.pressure")] == [5, 5]
    published.run_periodic(1.8)
    assert published.on("live/n/p000c03.pressure")[0]["n"] == 5


def test_frames_of_some_patches_of_a_page_are_joined() -> None:
    published = Published(LARGE)
    whole = {0: np.full(20, 1000.0), 1: np.full(20, 2000.0)}
    for now, sequence, kept in ((1.0, 0, (0, 1)), (1.1, 1, (1,)), (1.2, 2, (0,)), (1.3, 3, (1,))):
        values = {number: value + 100.0 * sequence for number, value in whole.items()}
        frame = LARGE.frame(sequence, values)
        some = tuple(each for each in frame.patches if each.patch in kept)
        published.add(replace(frame, patches=some), now)
    published.run_periodic(2.0)
    first, second = (published.on(f"live/n/patches/pad00{number}") for number in (0, 1))
    assert [item["n"] for item in first] == [5, 5]
    assert [item["n"] for item in second] == [5, 10]
    assert (first[1]["lo"][0], first[1]["hi"][0]) == (1200.0, 1300.0)
    assert (second[1]["lo"][0], second[1]["hi"][0]) == (2100.0, 2400.0)


def test_nothing_is_remembered_of_a_silent_node() -> None:
    published = Published(LARGE)
    published.add(LARGE.frame(1), 1.0)
    published.run_periodic(2.0)
    assert published.hulls._recent == {}


def test_senml_holds_channels_of_small_skins_and_patches_of_large_ones() -> None:
    small = Published(SMALL, senml=True)
    small.add(SMALL.frame(1), 1.0)
    (pack,) = small.on("senml/n/p000c02.pressure")
    records = dict(read_senml(orjson.dumps(pack).decode(), "n/p000c02.pressure/"))
    assert (records["lo"], records["hi"]) == (1000.0, 1100.0)
    large = Published(LARGE, senml=True)
    large.add(LARGE.frame(1, {0: np.full(20, 3500.0), 1: np.full(20, 2950.0)}), 1.0)
    assert {topic for topic in large.topics if topic.startswith("senml")} == {
        "senml/n/patches/pad000", "senml/n/patches/pad001",
    }  # fmt: skip
    contacts = []
    for name in "pad000", "pad001":
        (pack,) = large.on(f"senml/n/patches/{name}")
        records = dict(read_senml(orjson.dumps(pack).decode(), f"n/patches/{name}/"))
        contacts.append(
            (records["lo"], records["hi"], records["contact/lo"], records["contact/hi"])
        )
    assert contacts == [(3500.0, 3600.0, 1.0, 1.0), (2950.0, 3050.0, 0.0, 1.0)]


def test_senml_omits_times_that_it_reads_as_relative() -> None:
    published = Published(SMALL, senml=True)
    published.add(replace(SMALL.frame(1), time=(9, 9)), 1.0)
    assert published.on("live/n/p000c00.pressure")
    assert not [topic for topic in published.topics if topic.startswith("senml")]


EVENT = {
    "id", "node", "channel", "kind", "verdict", "time", "height", "prominence", "count", "unit",
    "coverage", "boot", "sequence", "detail",
}  # fmt: skip
"""The fields of an event of REST."""


def test_statements_are_events() -> None:
    said = SMALL.statements(7)
    events = list(public_payloads.statements("n", said, joined(SMALL)))
    assert {(topic, kept) for topic, _, kept in events} == {("eskin/v1/live/n/events", False)}
    peak, contact, gap = (orjson.loads(body) for _, body, _ in events)
    assert len({peak["id"], contact["id"], gap["id"]}) == 3
    assert (peak["kind"], peak["channel"], peak["verdict"], peak["unit"]) == (
        "peak", "p000c00.pressure", "possible", "Pa",
    )  # fmt: skip
    assert (peak["count"], peak["height"]) == ({"lo": 0, "hi": 2}, {"lo": 1.0, "hi": None})
    assert (contact["kind"], contact["verdict"], contact["coverage"]) == ("contact", "certain", 0.9)
    assert contact["count"] == {"lo": 1, "hi": 2}
    assert contact["detail"]["cells"] == {"lo": 1, "hi": 3}
    assert contact["detail"]["centroid"] == [{"lo": 0.0, "hi": 0.1}] * 2
    assert (gap["kind"], gap["detail"]["samples"], gap["detail"]["patches"]) == (
        "gap", 200, ["pad000"],
    )  # fmt: skip
    assert {item["sequence"] for item in (peak, contact, gap)} == {7}
    assert set(peak) == set(contact) == set(gap) == EVENT


def test_unbounded_samples_are_null() -> None:
    published = Published(SMALL)
    published.add(SMALL.frame(1, {0: np.array([[-math.inf, 5.0, 6.0]] * 5), 1: np.ones(2)}), 1.0)
    (item,) = published.on("live/n/p000c00.pressure")
    assert (item["lo"], item["hi"]) == (None, 100.0)
