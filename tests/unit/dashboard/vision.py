"""How colours look to people: contrast, colour blindness, distance."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pathlib import Path

Triple: TypeAlias = NDArray[np.float64]

_MACHADO: Final = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
"""Machado, Oliveira and Fernandes 2009, table 1, severity 1.0: of linear RGB."""
_BRETTEL: Final = (
    [[1.01277, 0.13548, -0.14826], [-0.01243, 0.86812, 0.14431], [0.07589, 0.80500, 0.11911]],
    [[0.93678, 0.18979, -0.12657], [0.06154, 0.81526, 0.12320], [-0.37562, 1.12767, 0.24796]],
)
_SIDE: Final = np.array([0.03901, -0.02788, -0.01113])
"""Brettel, Viénot and Mollon 1997 for tritanopia, of which the former is but an estimate; as
libDaltonLens has it for linear sRGB: a matrix for each side of the plane with this normal."""
EYES: Final = ("usual", *_MACHADO, "tritanopia by Brettel")

_XYZ: Final = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
_D65: Final = _XYZ.sum(axis=1)
_TOKEN: Final = re.compile(r"--([\w-]+):\s*([^;]+);")


@dataclass(frozen=True)
class Colour:
    """A colour of a style sheet.

    Attributes:
        rgb: Red, green and blue, 0 to 255.
        alpha: From 0, nothing, to 1, opaque.
    """

    rgb: tuple[float, float, float]
    alpha: float

    @classmethod
    def read(cls, text: str) -> Colour:
        """``#rrggbb`` or ``rgb(r g b / a%)``."""
        if text.startswith("#"):
            red, green, blue = (float(byte) for byte in bytes.fromhex(text[1:]))
            return cls((red, green, blue), 1.0)
        red, green, blue, percent = (float(number) for number in re.findall(r"[\d.]+", text))
        return cls((red, green, blue), percent / 100)

    def on(self, ground: Colour) -> Colour:
        """What is seen of it on an opaque ground."""
        pairs = zip(self.rgb, ground.rgb, strict=True)
        red, green, blue = (self.alpha * own + (1 - self.alpha) * other for own, other in pairs)
        return Colour((red, green, blue), 1.0)

    @property
    def linear(self) -> Triple:
        """Linear RGB, 0 to 1 (IEC 61966-2-1)."""
        share = np.array(self.rgb) / 255
        return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def read_tokens(path: Path) -> list[dict[str, str]]:
    """The custom properties of each rule of a style sheet that has some."""
    rules = re.findall(r"\{([^{}]*)\}", path.read_text())
    return [found for rule in rules if (found := dict(_TOKEN.findall(rule)))]


def contrast(one: Colour, other: Colour) -> float:
    """WCAG 2.2's contrast ratio, 1 to 21."""
    low, high = sorted(float(_XYZ[1] @ colour.linear) + 0.05 for colour in (one, other))
    return high / low


def seen(colour: Colour, eye: str) -> Triple:
    """The linear RGB that looks to usual eyes as the colour does to this one."""
    linear = colour.linear
    if eye in _MACHADO:
        linear = np.array(_MACHADO[eye]) @ linear
    elif eye == EYES[-1]:
        linear = np.array(_BRETTEL[0 if _SIDE @ linear >= 0 else 1]) @ linear
    return np.clip(linear, 0, 1)


def lab(linear: Triple) -> Triple:
    """CIELAB under D65 of linear RGB."""
    share = (_XYZ @ linear) / _D65
    bent = np.where(share > 216 / 24389, np.cbrt(share), (24389 / 27 * share + 16) / 116)
    return np.array([116 * bent[1] - 16, 500 * (bent[0] - bent[1]), 200 * (bent[1] - bent[2])])


def distance(one: Triple, other: Triple) -> float:
    """CIEDE2000 (ISO/CIE 11664-6) of two CIELAB colours, with all weights 1."""
    chroma = float(np.hypot(*one[1:]) + np.hypot(*other[1:])) / 2
    red = 1.5 - 0.5 * np.sqrt(chroma**7 / (chroma**7 + 25**7))
    (c1, h1), (c2, h2) = (_polar(red * a, b) for _, a, b in (one, other))
    turn = (h2 - h1 + 180) % 360 - 180 if c1 * c2 > 0 else 0.0
    hue = (h1 + turn / 2) % 360 if c1 * c2 > 0 else h1 + h2
    light, c = (one[0] + other[0]) / 2, (c1 + c2) / 2
    shape = (
        1
        - 0.17 * _cos(hue - 30)
        + 0.24 * _cos(2 * hue)
        + 0.32 * _cos(3 * hue + 6)
        - 0.20 * _cos(4 * hue - 63)
    )
    off = (light - 50) ** 2
    by_light = (other[0] - one[0]) / (1 + 0.015 * off / np.sqrt(20 + off))
    by_chroma = (c2 - c1) / (1 + 0.045 * c)
    by_hue = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2)) / (1 + 0.015 * c * shape)
    spread = 30 * np.exp(-(((hue - 275) / 25) ** 2))
    bend = -2 * np.sqrt(c**7 / (c**7 + 25**7)) * np.sin(np.radians(2 * spread))
    return float(np.sqrt(by_light**2 + by_chroma**2 + by_hue**2 + bend * by_chroma * by_hue))


def _polar(a: float, b: float) -> tuple[float, float]:
    return float(np.hypot(a, b)), float(np.degrees(np.arctan2(b, a))) % 360


def _cos(degrees: float) -> float:
    return float(np.cos(np.radians(degrees)))
