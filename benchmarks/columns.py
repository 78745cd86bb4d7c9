"""A large skin in columns: what a stretch of the paper's hand takes, by part.

``python -m benchmarks.columns`` prints milliseconds of CPU a stretch of 100 ms.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from eskin_sensor_node.columns import build
from eskin_sensor_node.node.factory import build_clock
from eskin_sensor_node.tools.budget import NodeDesign
from eskin_sensor_node.world.scenario import Stage, read_scenario

from benchmarks.report import Row, at_most
from eskin.interval import Interval
from eskin.wire.frames import PatchSamples

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_sensor_node.columns import PadColumns, SkinStretch
    from eskin_sensor_node.settings import NodeSettings

_SEED: Final = 1
_RATES: Final = (50.0, 100.0)
_MOST: Final = 12.0
"""Percent of a core at 50 Hz, in proportion at others."""


def measure_columns() -> list[Row]:
    """The share of a core that 8400 taxels take over a whole scenario, with their truth."""
    rows = []
    for hertz in _RATES:
        settings = _settings(hertz)
        share = 100.0 * _seconds(_advance(_columns(settings))) / (settings.skin.stretch * 1e-9)
        name = f"8400 taxels in columns, {hertz:g} Hz"
        rows.append(at_most(name, share, "% of a core", _MOST * hertz / _RATES[0]))
    return rows


def parts(hertz: float) -> dict[str, float]:
    """Milliseconds of CPU a stretch: scenario, chain with its noise, inversion, codes of frames."""
    settings = _settings(hertz)
    columns, skin = _columns(settings), settings.skin
    stage = Stage(read_scenario(skin.scenario), columns.columns)
    instants = skin.period * np.arange(skin.rows)
    everything = _seconds(_advance(_columns(settings)))
    scenario = _seconds(lambda k: stage.stimulus(np.asarray((instants + k * skin.stretch) / 1e9)))
    sensed = _seconds(lambda k: columns.sense(instants + k * skin.stretch))
    stretches = list(columns.advance(20 * 10**9))
    coded = _seconds(lambda k: _pack(columns, stretches[k]))
    found = {
        "scenario": scenario,
        "chain": sensed - scenario,
        "inversion": everything - sensed,
        "all": everything,
        "codes": coded,
    }
    return {name: 1e3 * seconds for name, seconds in found.items()}


def _settings(hertz: float) -> NodeSettings:
    settings = NodeDesign.named("paper-hand").settings
    skin = settings.skin.model_dump() | {"sampling_hz": hertz}
    return settings.model_copy(update={"skin": type(settings.skin)(**skin)})


def _columns(settings: NodeSettings) -> PadColumns:
    clock = build_clock(settings, seed=_SEED, boot=0, start=0, monotonic=lambda: 0)
    return build(settings, _SEED, boot=0, clock=clock)


def _advance(columns: PadColumns) -> Callable[[int], object]:
    return lambda _: list(columns.advance(columns.next_due))


def _pack(columns: PadColumns, stretch: SkinStretch) -> list[Any]:
    return [
        PatchSamples.pack(
            Interval(each.lo, each.hi),
            columns.patches[each.patch].least_width,
            patch=each.patch,
            grid=0,
            first_row=stretch.grids[0].first_row,
        )
        for each in stretch.patches
    ]


def _seconds(do: Callable[[int], object]) -> float:
    """CPU of a stretch, on the mean over the scenario's 20 s."""
    do(0)
    begin = time.process_time()
    for number in range(1, 200):
        do(number)
    return (time.process_time() - begin) / 199


def main() -> None:
    """Print a line a rate."""
    for hertz in _RATES:
        found = parts(hertz)
        print(f"{hertz:g} Hz", *(f"{name} {ms:.2f} ms" for name, ms in found.items()), sep="  ")


if __name__ == "__main__":
    main()
