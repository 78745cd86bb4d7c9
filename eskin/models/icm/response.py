"""Response of a first-order branch to a sine switched on at time 0, and its slope in τ.

With ``a = ωt``, ``x = ωτ``, ``s = t/τ``, both branches of the ICM answer with one function (eq. 26
and 27 without their amplitude):

    h = [sin(a + ψ) - x cos(a + ψ) - (sin ψ - x cos ψ) e**-s] / (1 + x²)

Written so, it cancels to nothing at small times. Here ``c0 = 1/(1 + x²)``, ``c1 = x/(1 + x²)``:

    h = sin ψ·(c1 sin a + c0 (g - v)) + cos ψ·(c0 (sin a - a) + c1 (v + f))

with ``v = 1 - cos a``, ``g = 1 - e**-s``, ``f = e**-s - 1 + s``, each known to full relative
precision, while ``a <= 1``; later ``sin a`` stands for ``sin a - a``, and ``-g`` for ``f``, which
leaves the phasor's two products:

    h = (c1 sin ψ + c0 cos ψ) sin a + (c1 cos ψ - c0 sin ψ)(v - g)

The slope ``d = τ ∂h/∂τ`` is differentiated from both forms term by term.

Rounding: with ``T`` the sum of the sizes of the first form's terms, each carries (in units of
u = 2**-53) 1.2 for its coefficient, 2.7 for sin ψ or cos ψ, 2 for their product and sum, at most 10
for its factor (``f``: 8, and 2 for ``s``; ``sin a - a``: 8; the others 4.4), and 1 to 4 for the
sums it passes through, 2 where the factor is ``f``; so the computed ``h`` is within ``18 u·T``.
``τ`` itself may be off by one rounding (it is a product or a quotient of parameters), which moves
``h`` by ``u·|d| <= 3 u·T``. `ROUNDING` = 24 u covers both, and ``3·ROUNDING·T`` the slope. Terms
below 1e-300 lose bits to gradual underflow: `UNDERFLOW` besides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import inlined, part
from eskin.models.icm.clock import PI, PI_LOW, phase_of
from eskin.models.icm.decay import decay

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.models.icm.clock import Sample

    Branch: TypeAlias = tuple[float, float, float, float, float, float]
    Phase: TypeAlias = tuple[float, float, float, float]

ROUNDING: Final = 12 * 2.0**-52
"""Bound of the error of ``h``, relative to ``T``, the sum of the sizes of its terms."""
UNDERFLOW: Final = 128 * 5e-324
"""Bound of the error of ``h`` besides, from gradual underflow."""
UNDERFLOW_SIZE: Final = UNDERFLOW / ROUNDING
"""A sum of sizes with that error: a weight on ``h`` weighs the error from underflow, too."""
_PHASE_ERROR: Final = 2.0**-45  # of the phase: 2**-100 of it, divided by ROUNDING, and more


@part
def branch(frequency: float, tau: float) -> Branch:
    """What a branch of time constant ``tau`` needs at every sample.

    Returns:
        1/τ in two words, c0, c1, ``q = x²/(1 + x²)`` and x; each within 1.2 u.
    """
    inverse = 1.0 / tau
    inverse_low = fma(-tau, inverse, 1.0) * inverse
    turns = 2.0 * frequency * tau
    rest = fma(2.0 * frequency, tau, -turns)
    x = turns * PI
    x_low = fma(turns, PI, -x) + fma(turns, PI_LOW, rest * PI)
    slow = x > 1.0
    inverse_x = 1.0 / x if slow else 0.0
    z = inverse_x if slow else x
    z_low = (fma(-x, inverse_x, 1.0) - x_low * inverse_x) * inverse_x if slow else x_low
    square = z * z
    square_low = fma(z, z, -square) + 2.0 * z * z_low
    below = 1.0 + square
    below_low = ((1.0 - below) + square) + square_low
    u0 = 1.0 / below
    u0_low = -u0 * fma(u0, below, -1.0) - u0 * u0 * below_low
    first = u0 + u0_low
    second = fma(square, u0, fma(square, u0_low, square_low * u0))
    c1 = fma(z, u0, fma(z, u0_low, z_low * u0))
    c0 = second if slow else first
    return inverse, inverse_low, c0, c1, first if slow else second, x


@part
def phase_parts(phase: float) -> Phase:
    """Sine and cosine of ψ, and their sizes as the error bound needs them."""
    sine, cosine = phase_of(phase)
    slack = abs(phase) * _PHASE_ERROR
    return sine, cosine, abs(sine) + slack, abs(cosine) + slack


@inlined
def respond(of: Branch, phase: Phase, sample: Sample) -> tuple[float, float, float, float, float]:
    """``h``, its slope ``d``, the sum of sizes ``T``, ``s`` and ``e**-s`` at one sample."""
    inverse, inverse_low, c0, c1, q, _ = of
    sine_phase, cosine_phase, sine_size, cosine_size = phase
    t, sine, short_sine, v, _, early = sample
    s = fma(t, inverse, t * inverse_low)
    left, gone, lag = decay(s)
    k = c1 * (1.0 - 2.0 * q)
    e = 2.0 * q * c0
    in_phase, lagging = sine_phase * c1 + cosine_phase * c0, cosine_phase * c1 - sine_phase * c0
    turn, lagging_turn = sine_phase * k - cosine_phase * e, cosine_phase * k + sine_phase * e
    swing = v - gone
    h = fma(lagging, swing, in_phase * sine)
    slope = fma(turn, sine, fma(lagging_turn, swing, lagging * (s * left)))
    rest = gone
    if early:
        rest = lag
        both = v + lag
        h = fma(sine_phase * c1, sine, -(sine_phase * c0) * swing)
        h = fma(cosine_phase * c1, both, fma(cosine_phase * c0, short_sine, h))
        slope = fma(
            sine_phase * k, sine, fma(sine_phase * e, swing, -(sine_phase * c0) * (s * left))
        )
        slope = fma(-(cosine_phase * c1), s * gone, fma(-(cosine_phase * e), short_sine, slope))
        slope = fma(cosine_phase * k, both, slope)
    size = fma(
        sine_size,
        fma(c1, abs(sine), c0 * (gone + v)),
        cosine_size * fma(c0, abs(short_sine), c1 * (v + rest)),
    )
    return h, slope, size, s, left
