"""A tube refuses parts that do not fit, and says which."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eskin import Interval, Tube
from eskin.errors import IntervalError

GIVEN: dict[str, Any] = {
    "time": (1000, 1003), "dt": 10, "values": Interval([1.0, 2.0], [2.0, 4.0]), "unit": "F",
    "coverage": 1.0,
}  # fmt: skip


def test_samples_are_drawn_in_the_middle_of_their_time() -> None:
    tube = Tube(**GIVEN)
    assert len(tube) == 2
    assert tube.instants.tolist() == [1001, 1011]
    assert tube.time_error == 2
    assert tube.first_instant - tube.time_error <= 1000
    assert tube.first_instant + tube.time_error >= 1003


@pytest.mark.parametrize(
    "part", [slice(2, 5), slice(-3, None), slice(None, None, 3), slice(7, 7), slice(1, 99, 4)]
)
def test_slice_keeps_the_instants_of_its_samples(part: slice) -> None:
    tube = Tube(**{**GIVEN, "values": Interval(np.arange(8.0), np.arange(8.0) + 1.0)})
    cut = tube[part]
    assert cut.instants.tolist() == tube.instants[part].tolist()
    assert cut.values.inf.tolist() == tube.values.inf[part].tolist()
    assert cut.values.sup.tolist() == tube.values.sup[part].tolist()
    assert (cut.unit, cut.coverage, cut.time_error) == (tube.unit, tube.coverage, tube.time_error)


def test_what_is_no_forward_slice_is_refused() -> None:
    tube: Any = Tube(**GIVEN)
    for part in (0, slice(None, None, -1)):
        with pytest.raises(IntervalError, match="tube"):
            tube[part]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"values": np.array([1.0, 2.0])}, "values must be an Interval, not ndarray"),
        ({"values": Interval(1.0)}, "one axis"),
        ({"time": (0.5, 1.5)}, "whole ns"),
        ({"dt": 10.5}, "whole ns"),
        ({"time": (3, 2)}, "reversed"),
        ({"dt": 0}, "positive"),
        ({"coverage": float("nan")}, "coverage"),
        ({"coverage": 1.5}, "coverage"),
    ],
)
def test_parts_that_do_not_fit_are_refused(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(IntervalError, match=said):
        Tube(**GIVEN | changed)
