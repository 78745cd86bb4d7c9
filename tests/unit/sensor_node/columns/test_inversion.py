"""A skin's pressures are those of the firmware in plain Python, byte for byte."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.columns.inversion import (
    PadColumnsInversion,
    least_width,
    surroundings,
)
from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.kinds.skin_section import SkinSection
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.world.skin.shapes import FlatShape
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.unit.sensor_node.columns.skins import columns_of, flat, whole
from tests.unit.sensor_node.designs import settings as node_settings

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from eskin_sensor_node.kinds.converter import Codes
    from numpy.typing import NDArray

    from eskin.interval import Floats

ROWS, COLUMNS, SAMPLES = 3, 4, 3
SKIN = FlatShape(shape="flat", rows=ROWS, columns=COLUMNS, pitch_m=5e-3).build()
TAXELS = len(SKIN)
SMALL_HAND = Profile.read("small-hand").sections["skin"]


def section(*, air: bool = True, **pad: Any) -> SkinSection:
    given = SMALL_HAND | {"pad": SMALL_HAND["pad"] | pad}
    return SkinSection(**given if air else given | {"thermometer": {}, "hygrometer": {}})


def by_firmware(
    skin: SkinSection,
    codes: Mapping[str, Codes],
    beside: Sequence[Sequence[int]],
    around: Sequence[Sequence[int]],
) -> tuple[Floats, Floats]:
    """What the firmware in plain Python makes of codes, taxel by taxel.

    Args:
        skin: The data sheets.
        codes: Of each input, taxels × samples.
        beside: Of each taxel, all neighbours.
        around: Those of them that are measured.
    """
    taxels = [
        skin.taxel.firmware(data_sheet(skin.taxel, skin.companions), inversion) for _ in beside
    ]
    n = codes["current"].shape[1]
    bounds = [[[0.0] * n for _ in range(2 * len(t.quantities))] for t in taxels]
    for k, taxel in enumerate(taxels):
        taxel.surround(len(beside[k]))
        taxel.measure([codes[name][k].tolist() for name in taxel.inputs], n, bounds[k])
    for k, taxel in enumerate(taxels):
        taxel.separate(n, bounds[k], [taxels[j].felt(bounds[j]) for j in around[k]])
    lows, highs = (np.array([each[place] for each in bounds]) for place in (8, 9))
    return lows, highs


def in_columns(
    skin: SkinSection, codes: Mapping[str, Codes], neighbours: Any, measured: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    columns = PadColumnsInversion(skin.taxel, skin.companions)
    columns.measure(codes)
    columns.separate(surroundings(neighbours, measured))
    return columns.pressure


def beside(taxel: int) -> list[int]:
    return [k for k in SKIN.neighbours[taxel].tolist() if k != NO_NEIGHBOUR]


def of_range(bits: int) -> st.SearchStrategy[int]:
    last = (1 << bits) - 1
    ends = st.sampled_from([0, 1, 2, last - 2, last - 1, last])
    return ends | st.integers(0, last)


pads = st.fixed_dictionaries(
    {},
    optional={
        "doubtful_neighbours": st.integers(0, 5),
        "elasticity_tolerance": st.sampled_from([0.0, 0.02, 0.3]),
        "plate_area_tolerance": st.sampled_from([0.0, 1e-3, 0.1]),
        "resistance_tolerance": st.sampled_from([0.0, 1e-2]),
        "adc_gain_error": st.sampled_from([0.0, 1e-3]),
        "adc_offset_error": st.sampled_from([0.0, 3.0]),
        "adc_nonlinearity": st.sampled_from([0.0, 1.5]),
        "gain_tolerance": st.sampled_from([0.0, 1e-3]),
        "crosstalk": st.sampled_from([0.1, 0.5]),
        "permittivity_per_K": st.sampled_from([0.0, 1e-3, -1e-2]),
        "adc_min_A": st.sampled_from([0.0, 1e-4]),
        "elasticity_Pa": st.sampled_from([1e3, 1e5]),
        "noise": st.sampled_from(
            [{"kind": "uniform", "bound": 0.0}, {"kind": "gaussian", "sigma": 1e-7}]
        ),
    },
)


@pytest.mark.nightly
@given(st.data(), pads, st.booleans(), st.sampled_from([4, 12]))
@settings(max_examples=150, deadline=None)
def test_pressures_are_the_firmware_s_to_the_byte(
    data: st.DataObject,
    pad: dict[str, Any],
    air: bool,  # noqa: FBT001 - drawn
    bits: int,
) -> None:
    skin = section(air=air, adc_bits=bits, **pad)
    widths = {"current": bits} | dict.fromkeys(skin.air, 12)
    codes = {
        name: np.array(
            data.draw(
                st.lists(of_range(width), min_size=TAXELS * SAMPLES, max_size=TAXELS * SAMPLES)
            ),
            np.int64,
        ).reshape(TAXELS, SAMPLES)
        for name, width in widths.items()
    }
    measured = np.array(data.draw(st.lists(st.booleans(), min_size=TAXELS, max_size=TAXELS)))
    around = [[k for k in beside(taxel) if measured[k]] for taxel in range(TAXELS)]
    expected = by_firmware(skin, codes, [beside(k) for k in range(TAXELS)], around)
    found = in_columns(skin, codes, SKIN.neighbours, measured)
    for own, firmware in zip(found, expected, strict=True):
        assert own.tobytes() == firmware.tobytes()


@pytest.mark.parametrize("share", [None, "n2"])
def test_a_stretch_of_a_skin_is_the_firmware_s_of_the_codes_that_were_sensed(
    tmp_path: Path, share: str | None
) -> None:
    if share is None:
        node = node_settings(tmp_path, "small-hand")
    else:  # its seam runs through the press
        node = flat(tmp_path, 16, 17, node=share, controllers=("n1", "n2", "n3", "n4"))
    columns, again = columns_of(node), columns_of(node)
    list(columns.advance(10 * node.skin.stretch))
    list(again.advance(10 * node.skin.stretch))
    sensed = again.sense(10 * node.skin.stretch + node.skin.period * np.arange(node.skin.rows))
    lo, hi, truth = whole(columns, columns.advance(columns.next_due))
    skin, place = node.skin.skin, {name: k for k, name in enumerate(columns.columns)}
    order = np.argsort(columns.columns)
    all_beside = [
        [skin.names[k] for k in skin.neighbours[skin.numbers[name]].tolist() if k != NO_NEIGHBOUR]
        for name in columns.columns
    ]
    around = [[place[other] for other in names if other in place] for names in all_beside]
    numbers = [[skin.numbers[other] for other in names] for names in all_beside]
    expected = by_firmware(node.skin, sensed.readings[0].codes, numbers, around)
    assert (place.keys() == set(skin.names)) is (share is None)
    assert lo.tobytes() == expected[0][order].T.tobytes()
    assert hi.tobytes() == expected[1][order].T.tobytes()
    assert truth.tobytes() == sensed.truth["pressure"][order].T.tobytes()


@pytest.mark.parametrize("air", [True, False])
def test_no_sample_feels_with_less_width_than_stated(*, air: bool) -> None:
    skin = section(air=air)
    least = least_width(skin.taxel)
    columns = PadColumnsInversion(skin.taxel, skin.companions)
    random = np.random.default_rng(3)
    current = np.arange(4096)[:, None]
    codes = {"current": current} | {
        name: random.integers(0, 4096, current.shape) for name in skin.air
    }
    columns.measure(codes)
    lows, highs = columns.pressure
    bounded = np.isfinite(lows) & np.isfinite(highs)
    assert np.count_nonzero(bounded) > 2000
    assert 0.0 < least <= (highs - lows)[bounded].min()


def test_unmeasured_neighbours_widen(tmp_path: Path) -> None:
    node = flat(tmp_path, 5, 5)
    columns = columns_of(node)
    sensed = columns.sense(np.array([1_700_000_000]))
    skin = node.skin.skin.neighbours
    order = np.argsort(columns.columns)
    codes = {name: each[order] for name, each in sensed.readings[0].codes.items()}
    lows, highs = in_columns(node.skin, codes, skin, np.ones(25, np.bool_))
    lows, highs = lows.copy(), highs.copy()
    less, more = in_columns(node.skin, codes, skin, np.arange(25) != 12)
    assert np.all(less <= lows)
    assert np.all(more >= highs)
    neighbours = [7, 11, 13, 17]
    assert np.all(less[neighbours] < lows[neighbours])


def test_scenario_whose_name_is_no_text_is_refused() -> None:
    with pytest.raises(ValidationError):
        SkinSection.model_validate(SMALL_HAND | {"scenario": "hand\udcba.toml"})
