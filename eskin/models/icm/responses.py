"""Source, MagFES current and EcFES voltage of the ICM as enclosures (eq. 26 to 29)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval
from eskin.models.icm.boxes import current_boxes, voltage_boxes
from eskin.models.icm.ecfes import voltage_rows
from eskin.models.icm.layout import lay_out
from eskin.models.icm.magfes import current_rows
from eskin.models.icm.source import source_rows
from eskin.models.icm.thin import thin_current_rows, thin_voltage_rows
from eskin.models.parameters import finite, not_negative, positive

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from eskin.models.icm.layout import KernelLayout
    from eskin.models.parameters import Bounds, Floats, Parameter

    Indices = NDArray[np.int64]
    Kernel = Callable[[Floats, Indices, Floats, Floats, Floats], None]


def magfes_current(
    time: ArrayLike,
    *,
    amplitude: Bounds,
    frequency: Bounds,
    phase: Bounds,
    coil_resistance: Bounds,
    inductance: Bounds,
) -> Interval:
    """Current i1 of the MagFES branch from rest (eq. 26, 28): all values over the parameters.

        i1(t) = Vm/|Z1|·[sin(ωt + ψ - φ1) - sin(ψ - φ1)·e^(-R1 t/L)]·1(t)

    As the paper has it, with the sine of eq. 23's source. The bounds are the true range but for
    rounding where i1 is monotone, and within 1.001 of its width elsewhere: an extremum inside the
    intervals is found and bracketed, which corners would miss.

    Args:
        time: t in s, any shape; the current is zero before 0.
        amplitude: Vm in V.
        frequency: f in Hz, >= 0. An interval of two different ends costs 1000 times more, and
            where it leaves ωt open by ten turns and more, the bounds may be some percent wide.
        phase: ψ in rad. An interval of two different ends costs 1000 times more.
        coil_resistance: R1 in Ω, > 0. The paper does not give it.
        inductance: L in H, > 0.

    Returns:
        Current in A, of the broadcast shape of all arguments.

    Raises:
        IntervalError: An argument is not allowed, or shapes do not fit each other.
    """
    parameters = [
        finite("amplitude", amplitude),
        not_negative("frequency", frequency),
        finite("phase", phase),
        positive("coil_resistance", coil_resistance),
        positive("inductance", inductance),
    ]
    return _evaluate(time, parameters, (thin_current_rows, current_rows, current_boxes))


def ecfes_voltage(
    time: ArrayLike,
    *,
    amplitude: Bounds,
    frequency: Bounds,
    phase: Bounds,
    capacitor_resistance: Bounds,
    capacitance: Bounds,
) -> Interval:
    """Voltage u_c of the EcFES capacitor from rest (eq. 27, 29): all values over the parameters.

        u_c(t) = Vm/(|Z2| ωC)·[sin(ωt + ψ + φ2 - 90°) - sin(ψ + φ2 - 90°)·e^(-t/(R2 C))]·1(t)

    As the paper has it, with the sine of eq. 23's source. It depends on R2·C alone, besides the
    source. As tight as `magfes_current`.

    Args:
        time: t in s, any shape; the voltage is zero before 0.
        amplitude: Vm in V.
        frequency: f in Hz, >= 0. An interval of two different ends costs 1000 times more, and
            where it leaves ωt open by ten turns and more, the bounds may be some percent wide.
        phase: ψ in rad. An interval of two different ends costs 1000 times more.
        capacitor_resistance: R2 in Ω, > 0. The paper does not give it.
        capacitance: C in F, > 0.

    Returns:
        Voltage in V, of the broadcast shape of all arguments.

    Raises:
        IntervalError: An argument is not allowed, or shapes do not fit each other.
    """
    parameters = [
        finite("amplitude", amplitude),
        not_negative("frequency", frequency),
        finite("phase", phase),
        positive("capacitor_resistance", capacitor_resistance),
        positive("capacitance", capacitance),
    ]
    return _evaluate(time, parameters, (thin_voltage_rows, voltage_rows, voltage_boxes))


def source_voltage(
    time: ArrayLike, *, amplitude: Bounds, frequency: Bounds, phase: Bounds
) -> Interval:
    """Source ``V(t) = Vm·sin(ωt + ψ)·1(t)`` of the ICM: all values over the parameters.

    Args:
        time: t in s, any shape; the source is off before 0.
        amplitude: Vm in V.
        frequency: f in Hz, >= 0.
        phase: ψ in rad.

    Returns:
        Voltage in V, of the broadcast shape of all arguments.

    Raises:
        IntervalError: An argument is not allowed, or shapes do not fit each other.
    """
    parameters = [
        finite("amplitude", amplitude),
        not_negative("frequency", frequency),
        finite("phase", phase),
    ]
    work = lay_out(time, parameters)
    return _run(work, [(source_rows, np.ones(len(work.rows), dtype=bool))])


def _evaluate(
    time: ArrayLike, parameters: list[Parameter], kernels: tuple[Kernel, Kernel, Kernel]
) -> Interval:
    """Each row by the kernel for what is thin: all but the amplitude; the source; neither."""
    work = lay_out(time, parameters)
    _, f, phase, r, other = (work.rows[:, k] == work.rows[:, k + 1] for k in range(0, 10, 2))
    source = f & phase
    thin = source & r & other
    return _run(work, list(zip(kernels, (thin, source & ~thin, ~source), strict=True)))


def _run(work: KernelLayout, share: list[tuple[Kernel, NDArray[np.bool_]]]) -> Interval:
    lo, hi = np.empty((2, len(work.rows), work.times.shape[1]))
    for kernel, mine in share:
        if mine.all():
            kernel(work.rows, work.clock_of, work.times, lo, hi)
        elif mine.any():
            part_lo, part_hi = np.empty((2, int(mine.sum()), lo.shape[1]))
            kernel(work.rows[mine], work.clock_of[mine], work.times, part_lo, part_hi)
            lo[mine], hi[mine] = part_lo, part_hi
    return Interval._trusted(work.restore(lo), work.restore(hi))  # noqa: SLF001 - lo <= hi
