"""No flipped bit is served, raises what no caller expects, or makes anything vanish unsaid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.robustness.bitflips.flip import Flip, Place
from tests.robustness.bitflips.part import NAMES, Part
from tests.robustness.bitflips.verdict import Outcome, attack, judge

if TYPE_CHECKING:
    from pathlib import Path

FLIPS = {
    "flash": 20,
    "fleet": 20,
    "spool": 15,
    "keys": 20,
    "identity": 20,
    "authority": 15,
    "broker": 15,
    "store": 8,
    "store_log": 8,
    "frames": 8,
}
LONG = {"store", "store_log", "frames"}
"""Each flip is found by a whole cloud's store, opened anew."""


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.nightly) if n in LONG else n for n in NAMES],
)
def test_flipped_bit_is_named_or_without_effect(name: str) -> None:
    verdicts = list(attack(name, flips=FLIPS[name], seed=1))
    assert len(verdicts) == FLIPS[name]
    broken = [each for each in verdicts if each.outcome is Outcome.BROKEN]
    assert not broken, "\n".join(f"{each.flip}: {each.why}" for each in broken)
    assert any(each.outcome is Outcome.DETECTED for each in verdicts)


@pytest.mark.parametrize("read", [bytes.hex, lambda data: data.removeprefix(b"a").hex()])
def test_part_that_serves_what_was_flipped_is_found(tmp_path: Path, read: object) -> None:
    (tmp_path / "file").write_bytes(b"a")
    assert callable(read)
    part = Part(lambda _: None, lambda folder: {"it": read((folder / "file").read_bytes())}, ("*",))
    flip = Flip(Place("file", "", 0, 1), 0, 3)
    expected = part.read(tmp_path)
    flip.apply(tmp_path)
    assert judge(part, tmp_path, expected, [], flip).outcome is Outcome.BROKEN


def test_part_that_loses_something_unsaid_is_found(tmp_path: Path) -> None:
    part = Part(lambda _: None, lambda _: {}, ("*",))
    flip = Flip(Place("file", "", 0, 1), 0, 3)
    assert judge(part, tmp_path, {"it": 1}, [], flip).outcome is Outcome.BROKEN
    assert judge(part, tmp_path, {}, [], flip).outcome is Outcome.HARMLESS
