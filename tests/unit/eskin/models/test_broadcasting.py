"""Parameters and times of any shape broadcast as in numpy, at any length of a block."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pytest

from eskin import models
from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.models.broadcasting import BLOCK
from tests.unit.eskin.models.cases import CASES

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]

SHAPES: list[tuple[tuple[int, ...], ...]] = [
    ((), (), ()),
    ((1,), (1,), (1,)),
    ((7,), (), (7,)),
    ((5, 1), (7,), ()),
    ((5, 1), (1, 7), (5, 7)),
    ((2, 1, 3), (4, 1), (3,)),
    ((2, 4, 3), (1, 1, 3), (4, 1)),
    ((3, 1, 1), (1, 40), (2, 1)),
    ((300, 1), (2,), ()),
    ((0,), (), ()),
    ((4, 1), (0,), (1, 1)),
    ((BLOCK - 1,), (), ()),
    ((BLOCK,), (1,), ()),
    ((BLOCK + 1,), (BLOCK + 1,), ()),
    ((3, 1), (2 * BLOCK + 5,), ()),
]


def _interval(generator: np.random.Generator, shape: tuple[int, ...]) -> Interval:
    inf = generator.uniform(1.0, 2.0, shape)
    return Interval(inf, inf * generator.uniform(1.0, 1.1, shape))


@pytest.mark.parametrize("shapes", SHAPES)
@pytest.mark.parametrize("swings", [False, True])
def test_result_is_that_of_spread_out_parameters(
    shapes: tuple[tuple[int, ...], ...], *, swings: bool
) -> None:
    generator = np.random.default_rng(1)
    a, b, c = (_interval(generator, shape) for shape in shapes)
    whole = np.broadcast_shapes(*shapes)
    spread = [Interval(np.broadcast_to(x.inf, whole), np.broadcast_to(x.sup, whole)) for x in
              (a, b, c)]  # fmt: skip
    found, plain = (_evaluate(*each, swings=swings) for each in ((a, b, c), spread))
    assert found.inf.shape == found.sup.shape == whole
    assert np.array_equal(found.inf, plain.inf)
    assert np.array_equal(found.sup, plain.sup)
    for index in itertools.islice(np.ndindex(whole), 50):
        one = _evaluate(*(Interval(x.inf[index], x.sup[index]) for x in spread), swings=swings)
        assert (one.inf, one.sup) == (found.inf[index], found.sup[index])


def _evaluate(a: Interval, b: Interval, c: Interval, *, swings: bool) -> Interval:
    if swings:
        return models.harmonic_capacitance(c, minimum_capacitance=a, maximum_capacitance=b)
    return models.capacitance(relative_permittivity=a, area=b, distance=c)


def _transposed(values: Floats) -> Floats:
    return np.asfortranarray(values)


def _strided(values: Floats) -> Floats:
    return np.repeat(values, 2, axis=-1)[..., ::2]


def _read_only(values: Floats) -> Floats:
    made = values.copy()
    made.flags.writeable = False
    return made


def _swapped(values: Floats) -> Floats:
    return values.astype(">f8")


@pytest.mark.parametrize("form", [_transposed, _strided, _read_only, _swapped])
def test_layout_of_an_array_does_not_matter(form: Callable[[Floats], Floats]) -> None:
    times = np.random.default_rng(2).uniform(0.0, 1.0, (6, 50))
    plain = models.harmonic_capacitance(times, minimum_capacitance=1e-11, maximum_capacitance=1e-10)
    given = form(times)
    found = models.harmonic_capacitance(given, minimum_capacitance=1e-11, maximum_capacitance=1e-10)
    assert np.array_equal(found.inf, plain.inf)
    assert np.array_equal(given, times)
    assert given.flags.writeable is (form is not _read_only)


def test_whole_numbers_are_taken_as_numbers() -> None:
    found = models.rc_frequency_paper(resistance=[2, 4], capacitance=1)
    assert np.allclose(found.inf, [0.5, 0.25])


@pytest.mark.parametrize("name", CASES)
def test_shapes_that_do_not_fit_are_named(name: str) -> None:
    case = CASES[name]
    box = {key: np.full(2, low) for key, (low, _) in case.ranges.items()}
    first = next(iter(box))
    with pytest.raises(IntervalError, match=rf"{first} \(3,\)"):
        case.call(**box | {first: np.full(3, case.ranges[first][0])})
