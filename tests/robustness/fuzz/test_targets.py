"""Each target for an instant, from the same seed; ``make fuzz`` tries a million inputs of each."""

from __future__ import annotations

from pathlib import Path

import pytest

from eskin.runtime.memory import give_back
from tests.robustness.fuzz.growth import grown
from tests.robustness.fuzz.mutations.octets import mutate_octets
from tests.robustness.fuzz.run import BrokenError, run
from tests.robustness.fuzz.session import MOST_GROWTH_MIB
from tests.robustness.fuzz.target import NAMES, Target, load

INPUTS = 50
"""Of each target, its seeds among them."""


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::cryptography.utils.CryptographyDeprecationWarning")
@pytest.mark.parametrize("name", NAMES)
def test_target_holds(name: str, tmp_path: Path) -> None:
    target = load(name, tmp_path)
    with target.stack:
        run(target, inputs=len(target.seeds) + INPUTS, seed=1)


def test_broken_target_names_its_input() -> None:
    def check(data: bytes) -> None:
        if b"\xff" in data:
            raise KeyError(data)

    with pytest.raises(BrokenError) as caught:
        run(Target((b"good",), mutate_octets, check), inputs=1000, seed=1)
    assert b"\xff" in caught.value.data
    assert isinstance(caught.value.__cause__, KeyError)


def test_growth_is_reported() -> None:
    kept: list[bytes] = []

    def check(data: bytes) -> None:
        assert isinstance(data, bytes)

    sound = Target((b"good",), mutate_octets, check)
    leaking = Target((b"good",), mutate_octets, lambda data: kept.append(bytes(4096) + data))
    most = MOST_GROWTH_MIB * 2**20
    # What tests before have left free in this process would hide a leak.
    give_back()
    assert grown(sound, sound.seeds, inputs=10_000, seed=1) < most
    assert grown(leaking, leaking.seeds, inputs=10_000, seed=1) > most


def test_each_file_of_targets_is_a_target() -> None:
    folder = Path(__file__).with_name("targets")
    found = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert found == set(NAMES)
