"""``tests.unit.eskin.first_use``: what a notebook does; prints what is compiled meanwhile.

Every ufunc that intervals take, every public model, peaks, design and noise; with bounds that are
contiguous, read-only, strided, single and broadcast.
"""

from __future__ import annotations

import inspect
import sys
from typing import Any

import numpy as np
from numba.core import event

import eskin
from eskin.interval.interval import _UFUNCS
from eskin.wire.frames import EncodedFrame, Frame
from tests.unit.eskin.models.cases import CASES
from tests.unit.eskin.wire.frames.examples import FRAME

HALF = eskin.Interval(0.25, 0.5)
OTHERS = ("oscillation", "oscillation_paper", "coil_energy_euler_paper")


def main() -> None:
    """Do it all."""
    with event.install_recorder("numba:compile") as seen:
        _calculate()
        _ask_models()
        _ask_for_the_rest()
    compiled = {str(each.data["dispatcher"].py_func.__qualname__) for _, each in seen.buffer}
    sys.stdout.write("\n".join(sorted(compiled)))
    public = {name for name in eskin.models.__all__ if inspect.isfunction(_model(name))}
    assert public == {*CASES, *OTHERS} - {"alternating_current_of_eq_7"}


def _model(name: str) -> Any:
    return getattr(eskin.models, name)


def _layouts() -> list[eskin.Interval]:
    values = np.linspace(0.1, 0.8, 12)
    frozen = values.copy()
    frozen.flags.writeable = False
    return [
        HALF,
        eskin.Interval(values, values + 0.1),
        eskin.Interval(frozen, frozen),
        eskin.Interval(values[::2], values[::2] + 0.1),
        eskin.Interval(values.reshape(3, 4).T),
        eskin.Interval(np.broadcast_to(values, (2, 12))),
        eskin.Interval(np.float32(values)),
    ]


def _calculate() -> None:
    for x in _layouts():
        for ufunc in _UFUNCS:
            ufunc(*[x, HALF][: ufunc.nin])
            if ufunc.nin == 2:
                ufunc(HALF, x)
                ufunc(x, x)
        x.fma(2.0, HALF)
        x.exp10()
        x.rootn(4)
        x**3
        x.sum()
        x[None].sum(axis=-1)
        x[None].sum(axis=0)
        np.mean(x)
        np.cumsum(x)
        np.prod(x)
        np.where(x > HALF, x, 0.0)
        x.atan2(1)


def _ask_models() -> None:
    generator = np.random.default_rng(1)
    for case in CASES.values():
        for rows in (1, 5):
            case.evaluate(case.boxes(generator, rows))
        single = case.boxes(generator, 1)
        case.evaluate({name: value[0] for name, value in single.items()})
    times = np.linspace(0.0, 0.1, 9)
    times.flags.writeable = False
    eskin.models.oscillation(times, voltage=5.0, frequency=eskin.Interval(np.full(8, 50.0)))
    eskin.models.oscillation_paper(times, voltage=5.0, frequency=50.0)
    eskin.models.coil_energy_euler_paper(
        voltage=1.0, loss_resistance=5.0, inductance=1e-2, step=1e-5, steps=3
    )
    wide = eskin.Interval.relative([50.0, 60.0], 0.01)
    for frequency in (50.0, [[50.0], [60.0]], wide.reshape(2, 1), wide):
        for instants in (0.001, times, times[::2], list(times)):
            if frequency is wide and np.ndim(instants):
                continue
            for resistance in (1e3, eskin.Interval(1e3, 1.1e3)):
                icm = eskin.models.icm.IcmParameters(
                    frequency=frequency, coil_resistance=resistance, capacitor_resistance=resistance
                )
                icm.source_voltage(instants)
                icm.magfes_current(instants)
                icm.ecfes_voltage(instants)


def _ask_for_the_rest() -> None:
    signal = eskin.Interval(np.sin(np.arange(300.0)))
    eskin.find_peaks(signal, prominence=1)
    eskin.find_peaks(signal.inf[::3], signal.sup[::3], prominence=0.5)
    stream = eskin.PeakStream(0.5)
    stream.feed(signal)
    stream.finish()
    _ask_for_contacts()
    eskin.Tube((0, 9), 1000, signal, "F", 1.0)
    EncodedFrame.decode(FRAME.encode())
    assert Frame.decode(FRAME.encode()).values
    eskin.design.invert(
        eskin.design.Within(eskin.models.rc_frequency, lo=5e4, hi=1e5),
        {"resistance": eskin.Interval(1e3, 2e3), "capacitance": eskin.Interval(1e-9, 2e-9)},
        resolution=0.25,
    )


def _ask_for_contacts() -> None:
    """Of grids and graphs, at one instant and over time, and for gestures."""
    corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    triangle = eskin.Skin.from_edges(corners, 1e-6, [(0, 1), (1, 2), (0, 2)])
    for skin in (eskin.Skin.grid(3, 4, pitch=1e-3, area=np.full(12, 1e-6)), triangle):
        count = len(skin)
        lo = np.random.default_rng(1).normal(1e3, 500.0, (8, 2 * count))[:, ::2]
        hi = lo + 300.0
        hi.flags.writeable = False
        instants = [eskin.find_contacts(lo[k], hi[k], skin, 1e3) for k in range(2)]
        eskin.find_contacts(np.full(count, np.nan), np.zeros(count), skin, 1000)
        eskin.link_contacts(*instants)
        times = np.repeat(np.arange(8), 2).reshape(8, 2)
        eskin.track_contacts(lo, hi, times, skin, 1e3)
        stream = eskin.ContactStream(skin, 1e3)
        stream.feed(lo[::2].tolist(), hi[::2], times[::2])
        stream.finish()
        eskin.find_gestures(lo, hi, times, skin, 1e3)


if __name__ == "__main__":
    main()
