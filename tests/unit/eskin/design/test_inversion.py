"""What set inversion calls certain holds at every sample, and what it calls never at none."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from rich.console import Console

from eskin.design import (
    All,
    Narrower,
    Paving,
    Region,
    Within,
    draw_paving,
    invert,
    progress_bar,
)
from eskin.design.plot import LOOKS
from eskin.errors import DesignError
from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin.design import Requirement

EPSILON_0 = 8.854e-12
SPACE = {"distance": Interval(5e-4, 5e-3), "permittivity": Interval(1.0, 5.0)}
TOUCH = {"area": Interval(1e-5, 1e-4)}


def capacitance(*, distance: Interval, permittivity: Interval, area: Interval) -> Interval:
    return permittivity * area / distance * EPSILON_0


def plain(point: Mapping[str, float], area: float, **moved: float) -> float:
    values = {name: value * (1.0 + moved.get(name, 0.0)) for name, value in point.items()}
    return EPSILON_0 * values["permittivity"] * area / values["distance"]


def meets_band(point: Mapping[str, float]) -> bool:
    return all(plain(point, area) >= 1.5e-13 for area in np.linspace(1e-5, 1e-4, 11))


def width(point: Mapping[str, float], area: float) -> float:
    shares = (-0.05, 0.0, 0.05)
    values = [plain(point, area, distance=d, permittivity=p / 2.5) for d in shares for p in shares]
    return max(values) - min(values)


def meets_width(point: Mapping[str, float]) -> bool:
    return all(width(point, area) <= 3e-13 for area in np.linspace(1e-5, 1e-4, 11))


BAND = Within(capacitance, lo=1.5e-13, for_every=TOUCH)
WIDTH = Narrower(
    capacitance,
    width=3e-13,
    tolerance={"distance": 0.05, "permittivity": 0.02},
    for_every=TOUCH,
)
SLOPES = replace(WIDTH, expression=True, pieces=4)
CASES: dict[str, tuple[Requirement, Callable[[Mapping[str, float]], bool]]] = {
    "band": (BAND, meets_band),
    "width": (WIDTH, meets_width),
    "slopes": (SLOPES, meets_width),
    "both": (All((BAND, WIDTH)), lambda point: meets_band(point) and meets_width(point)),
}


def samples(paving: Paving, region: Region, count: int) -> list[dict[str, float]]:
    random = np.random.default_rng(7)
    chosen = np.flatnonzero(paving.regions == region)
    picked = random.choice(chosen, count)
    points = random.uniform(paving.lo[picked], paving.hi[picked])
    return [dict(zip(paving.space, map(float, point), strict=True)) for point in points]


@pytest.mark.parametrize("name", CASES)
def test_certain_boxes_hold_everywhere_and_never_boxes_nowhere(name: str) -> None:
    requirement, meets = CASES[name]
    paving = invert(requirement, SPACE, resolution=1 / 128)
    assert all(meets(point) for point in samples(paving, Region.CERTAIN, 400))
    assert not any(meets(point) for point in samples(paving, Region.NEVER, 400))
    assert paving.share(Region.CERTAIN) > 0.03
    assert paving.share(Region.NEVER) > 0.05
    assert paving.share(Region.POSSIBLE) < 0.15
    assert sum(map(paving.share, Region)) == pytest.approx(1.0, abs=1e-12)


def test_finer_resolution_leaves_less_undecided() -> None:
    shares = [
        invert(BAND, SPACE, resolution=resolution).share(Region.POSSIBLE)
        for resolution in (1 / 16, 1 / 64, 1 / 256)
    ]
    assert shares[0] > 2 * shares[1] > 4 * shares[2]


def test_slopes_decide_more_with_fewer_boxes() -> None:
    values, slopes = (invert(each, SPACE, resolution=1 / 128) for each in (WIDTH, SLOPES))
    assert 3 * len(slopes.lo) < len(values.lo)
    assert 6 * slopes.share(Region.POSSIBLE) < values.share(Region.POSSIBLE)
    for region in (Region.CERTAIN, Region.NEVER):
        assert slopes.share(region) > values.share(region)


def test_limit_of_boxes_is_kept_and_stays_honest() -> None:
    paving = invert(BAND, SPACE, resolution=1e-4, most=500)
    assert 250 < len(paving.lo) <= 500
    assert sum(map(paving.share, Region)) == pytest.approx(1.0, abs=1e-12)
    assert all(meets_band(point) for point in samples(paving, Region.CERTAIN, 200))


def test_progress_rises_to_one() -> None:
    stated: list[float] = []
    invert(BAND, SPACE, progress=stated.append)
    assert stated == sorted(stated)
    assert stated[-1] == 1.0
    assert len(stated) > 5


def test_progress_bar_shows_the_share_that_is_done() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80)
    with progress_bar("looking", console=console) as progress:
        invert(BAND, SPACE, progress=progress)
    shown = cast("io.StringIO", console.file).getvalue()
    assert "looking" in shown
    assert "100%" in shown


@pytest.mark.parametrize(("x", "y"), [("distance", "permittivity"), ("permittivity", "distance")])
def test_picture_has_the_colour_of_each_region(x: str, y: str) -> None:
    canvas = Figure(figsize=(4, 3), dpi=100)
    axes = canvas.add_axes((0.0, 0.0, 1.0, 1.0))
    paving = invert(BAND, SPACE)
    draw_paving(paving, axes, x=x, y=y)
    legend = axes.get_legend()
    assert legend is not None
    legend.set_visible(False)
    buffer = io.BytesIO()
    canvas.savefig(buffer, format="png")
    buffer.seek(0)
    pixels = imread(buffer)[..., :3]
    for region, colour in LOOKS.items():
        near = np.all(np.abs(pixels - np.array(to_rgb(colour))) < 0.03, axis=2)
        assert np.mean(near) == pytest.approx(paving.share(region), abs=0.05)
    with pytest.raises(DesignError, match="a value in at"):
        draw_paving(paving, axes, x=x, y=x)


def test_point_gets_its_region() -> None:
    paving = invert(BAND, SPACE)
    assert paving.region(distance=5e-4, permittivity=5.0) is Region.CERTAIN
    assert paving.region(distance=5e-3, permittivity=1.0) is Region.NEVER
    with pytest.raises(DesignError, match="outside of the space"):
        paving.region(distance=1.0, permittivity=1.0)
    with pytest.raises(DesignError, match="give distance, permittivity"):
        paving.region(distance=1e-3)


@pytest.mark.parametrize(
    ("space", "resolution", "reason"),
    [
        ({}, 0.1, "no parameter"),
        ({"distance": (1e-3, 5e-3)}, 0.1, "distance: .* is no Interval; give eskin.Interval"),
        ({"distance": Interval(1e-3)}, 0.1, "thin"),
        ({"distance": Interval(1e-3, np.inf)}, 0.1, "no bounded interval"),
        ({"distance": Interval([1e-3, 2e-3], [4e-3, 5e-3])}, 0.1, "no bounded interval"),
        (SPACE, 0.0, "resolution"),
    ],
)
def test_unusable_space_is_refused(
    space: Mapping[str, Interval], resolution: float, reason: str
) -> None:
    with pytest.raises(DesignError, match=reason):
        invert(BAND, space, resolution=resolution)


def test_unusable_requirement_is_refused() -> None:
    with pytest.raises(DesignError, match="empty"):
        Within(capacitance, lo=2.0, hi=1.0)
    with pytest.raises(DesignError, match="tolerance of distance"):
        Narrower(capacitance, width=1.0, tolerance={"distance": 1.5})
    with pytest.raises(DesignError, match="no greatest width"):
        Narrower(capacitance, width=-1.0, tolerance={"distance": 0.1})
    with pytest.raises(DesignError, match="no requirement"):
        All(())
    with pytest.raises(DesignError, match="give 1 to 6"):
        Narrower(capacitance, width=1.0, tolerance={})
    with pytest.raises(DesignError, match="tolerance of gap: the space has distance, perm"):
        invert(Narrower(capacitance, width=1.0, tolerance={"gap": 0.1}, for_every=TOUCH), SPACE)
    with pytest.raises(DesignError, match="broadcasting"):
        invert(Within(lambda **_: Interval(1.0)), SPACE)


@pytest.mark.parametrize(
    ("for_every", "pieces", "reason"),
    [
        (TOUCH, 0, "pieces: 0"),
        (TOUCH, 2.5, "pieces: 2.5"),
        ({"area": 1e-4}, 8, "area: 0.0001 is no Interval"),
        ({"area": Interval(1e-5, np.inf)}, 8, "no bounded interval"),
        ({"area": Interval([1e-5, 2e-5])}, 8, "no bounded interval"),
    ],
)
def test_values_that_cannot_be_divided_are_refused(
    for_every: Any, pieces: Any, reason: str
) -> None:
    with pytest.raises(DesignError, match=reason):
        Within(capacitance, lo=1e-13, for_every=for_every, pieces=pieces)
    with pytest.raises(DesignError, match=reason):
        Narrower(
            capacitance, width=1.0, tolerance={"distance": 0.1}, for_every=for_every, pieces=pieces
        )


@pytest.mark.parametrize(
    "requirement",
    [
        Within(capacitance, for_every={"distance": Interval(1e-3, 2e-3)}),
        Narrower(
            capacitance,
            width=1.0,
            tolerance={"permittivity": 0.1},
            for_every={"distance": Interval(1e-3, 2e-3)},
        ),
    ],
)
def test_parameter_is_either_chosen_or_free(requirement: Requirement) -> None:
    with pytest.raises(DesignError, match="distance: in the space and in for_every"):
        invert(requirement, SPACE)


def test_output_without_a_value_meets_no_requirement() -> None:
    def root(*, distance: Interval, permittivity: Interval) -> Interval:
        return (permittivity - 5.5).sqrt() + distance

    assert invert(Within(root), SPACE).share(Region.NEVER) == 1.0
    tolerance = {"permittivity": 0.01}
    expression = Narrower(
        lambda distance, permittivity: np.sqrt(permittivity - 5.5) + distance,
        width=9.0, tolerance=tolerance, expression=True,
    )  # fmt: skip
    assert invert(expression, SPACE).share(Region.NEVER) == 1.0


def test_output_that_is_no_interval_and_region_that_is_none_are_named() -> None:
    with pytest.raises(DesignError, match="gave float; it must give an Interval"):
        invert(Within(lambda **_: cast("Interval", 3.0)), SPACE)
    with pytest.raises(ValueError, match="'sure' is not a valid Region"):
        invert(BAND, SPACE).share(cast("Region", "sure"))
