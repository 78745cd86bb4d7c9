"""Reduction of angles of any size in rad, beyond what `eskin.kernels.trig_double_double` reduces.

``x = m·2**e`` with a whole m of 53 bits. A table has ``2**e·2/π`` but for multiples of 4 (quarter
turns, so whole turns), for each e in four words (210 bits): times m, that is x in quarter turns but
for whole turns, within ``2**-156``. The products are kept exactly, and summed as if in three times
the bits of a float (Ogita, Rump and Oishi 2005, SumK with K = 3). No float comes nearer to a
multiple of π/2 than ``2**-61`` (Muller, "Elementary Functions", 3rd ed., table 11.1), which is
``2**-62`` quarter turns: so the rest is right within ``2**-80`` of itself.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels import double_double
from eskin.kernels.intrinsics import from_bits, to_bits
from eskin.kernels.jit import part

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.kernels.trig_double_double import Turned

_QUARTERS_OF_ONE: Final = int(
    "a2f9836e4e441529fc2757d1f534ddc0db6295993c439041fe5163abdebbc561b7246e3a424dd2e006492e"
    "ea09d1921cfe1deb1cb129a73ee88235f52ebb4484e99c7026b45f7e413991d639835339f49c845f8bbdf9"
    "283b1ff897ffde05980fef2f118b5a0a6d1f6d367ecf27cb09b74f463f669e5fea2d7527bac7ebe5f17b3d"
    "0739f78a5292ea6bfb5fb11f8d5d0856033046fc7b6babf0cfbc209af4361da9e391615ee61b086599855f",
    16,
)
"""``2/π · 2**1376``, rounded down."""
_PLACES: Final = 1376
_KEPT: Final = 400
_LEAST: Final = -4  # 2**48 is 2**52·2**-4
_GREATEST: Final = 971
_QUARTER: Final = (1.5707963267948966, 6.123233995736766e-17)
_MANTISSA: Final = (1 << 52) - 1
_HIDDEN: Final = 1075 << 52


def _quarters_of_powers() -> NDArray[np.float64]:
    """``2**e·2/π`` but for multiples of 4, in four words, from ``_LEAST`` on."""
    words = np.empty((_GREATEST - _LEAST + 1, 4))
    for row, e in enumerate(range(_LEAST, _GREATEST + 1)):
        rest = (_QUARTERS_OF_ONE >> (_PLACES - _KEPT - e)) % (4 << _KEPT)
        for column in range(4):
            word = float(rest)
            words[row, column] = math.ldexp(word, -_KEPT)
            rest -= int(word)
    return words


_WORDS: Final = _quarters_of_powers()


@part
def reduced_of_any(x: float) -> Turned:
    """Quarter turns, but for whole turns, and the rest in rad, for a finite ``|x| > 2**48``."""
    bits = to_bits(abs(x))
    size = from_bits((bits & _MANTISSA) | _HIDDEN)
    m = -size if x < 0.0 else size
    row = (bits >> 52) - 1075 - _LEAST
    terms = np.empty(7)
    for column in range(3):
        terms[2 * column], terms[2 * column + 1] = double_double.product_of(m, _WORDS[row, column])
    terms[6] = m * _WORDS[row, 3]
    terms[0] -= 4.0 * np.rint(0.25 * terms[0])
    terms[1] -= 4.0 * np.rint(0.25 * terms[1])
    quarters = np.rint(terms[0] + terms[1] + terms[2])
    terms[0] -= quarters
    for _ in range(2):
        for k in range(6):
            terms[k + 1], terms[k] = double_double.sum_of(terms[k], terms[k + 1])
    rest = terms[0] + terms[1] + terms[2] + terms[3] + terms[4] + terms[5]
    near = double_double.ordered(terms[6], rest)
    return quarters, double_double.mul(near, _QUARTER)
