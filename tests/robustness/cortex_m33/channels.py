"""Cases of what a channel does with its samples, and of messages and their sealing."""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from eskin_sensor_node.firmware.assembler import encode
from eskin_sensor_node.firmware.channel import Baseline, Smoothing
from eskin_sensor_node.firmware.message_writer import MessageWriter
from eskin_sensor_node.firmware.peaks import PeakDetector

from tests.robustness.cortex_m33.case import Case, reals
from tests.robustness.cortex_m33.inversions import Count

if TYPE_CHECKING:
    from array import array
    from collections.abc import Iterator

    from numpy.typing import NDArray

SAMPLES: Final = 250
"""Of a signal: a frame."""
_EVENT: Final = 8
"""Numbers that the program states an event."""
_MOST_EVENTS: Final = 64
_ROWS: Final = 25
"""Of a signal as a patch; the more rows, the less its first one counts."""
_FINEST: Final = -50
"""Exponent of a quantum of 1/64 of a signal's width."""
_TEXTS: Final = (0, 1024, 16384)
"""Bytes of a sealed message: whole blocks of 16; what is left counts with the message."""


def channels() -> Iterator[Count]:
    """What is done with each sample of a channel, with each message, and with each byte sent."""
    for lows, highs in _signals():
        yield Count("rest", [_rest(lows, highs)], SAMPLES)
        yield Count("smoothing", [_smoothing(lows, highs)], SAMPLES)
        yield Count("peaks", [_peaks(lows, highs)], SAMPLES)
        yield Count("encode_frame", [_encoded(lows, highs, _FINEST)], SAMPLES)
        yield from (Count("peak", [case], 1) for case in _peak_messages(lows, highs))
    for lows, highs in _any_signals():
        yield Count("encode_frame_any", [_encoded(lows, highs, _FINEST)], SAMPLES)
    for one, other in pairwise(map(_sealed, _TEXTS)):
        more = len(other.expected[3]) - len(one.expected[3])
        yield Count("seal_byte", [other], more, [one])
    yield Count("seal_message", [_sealed(1)], 1)


def _signals() -> Iterator[tuple[array[float], array[float]]]:
    """A rest with noise, touches, a triangle, codes that tie, and sides without a bound."""
    random = np.random.default_rng(11)
    time = np.arange(SAMPLES)
    rest = 9.6e-12 + 2e-15 * random.normal(size=SAMPLES)
    touch = rest + 1.5e-12 * np.exp(-(((time % 125) - 60.0) ** 2) / 200.0)
    triangle = 9.6e-12 + 1e-12 * np.abs(time % 50 - 25.0) / 25.0
    for middle in (rest, touch, triangle, np.round(touch, 13)):
        yield _tube(middle, 3e-14)
    lows, highs = _tube(touch, 3e-14)
    for k in range(40, 60):
        lows[k], highs[k + 5] = -np.inf, np.inf
    yield lows, highs


def _any_signals() -> Iterator[tuple[array[float], array[float]]]:
    """Bounds of any size and sign, small ones of both signs, subnormal ones, and infinite ones."""
    random = np.random.default_rng(12)
    patterns = random.integers(0, 0x7FF0 << 48, (2, SAMPLES), dtype=np.uint64).view(np.float64)
    yield _ordered(patterns * random.choice([-1.0, 1.0], patterns.shape))
    yield _ordered(random.normal(0.0, 5.0, (2, SAMPLES)))
    whole = random.integers(-9, 10, (2, SAMPLES)).astype(np.float64)
    yield _ordered(whole)
    yield _ordered(whole * 5e-324)
    yield _ordered(whole * 1e-310)
    yield _ordered(np.where(whole > 6.0, np.inf, np.where(whole < -6.0, -np.inf, whole * 0.1)))


def _ordered(pairs: NDArray[np.float64]) -> tuple[array[float], array[float]]:
    return reals(np.minimum(*pairs)), reals(np.maximum(*pairs))


def _tube(middle: NDArray[np.float64], half: float) -> tuple[array[float], array[float]]:
    return reals(middle - half), reals(middle + half)


def _rest(lows: array[float], highs: array[float]) -> Case:
    baseline = Baseline()
    baseline.lo, baseline.hi, baseline.known = 9.55e-12, 9.65e-12, True
    state = [baseline.lo, baseline.hi, 1.0]
    threshold = 0.3e-12
    stays = baseline.track(lows, highs, SAMPLES, threshold)
    after = [baseline.lo, baseline.hi, float(stays)]
    return Case.of("rest", state, threshold, lows, highs, after=[after, lows, highs])


def _smoothing(lows: array[float], highs: array[float]) -> Case:
    past = Smoothing(0.9)
    state = [0.0, 0.0, 0.9, 1.0]
    smoothed = reals(lows), reals(highs)
    past.smooth(*smoothed, SAMPLES)
    after = [past.lo, past.hi, 0.9, float(past.fresh)]
    return Case.of("smoothing", state, lows, highs, after=[after, *smoothed])


def _peaks(lows: array[float], highs: array[float]) -> Case:
    detector = PeakDetector(0.3e-12, 1000)
    found = [*detector.feed(lows, highs, SAMPLES), *detector.gap(0)]
    reported = [float(len(found))]
    for event in found:
        reported += [event.verdict, event.first, event.last, event.count[1]]
        reported += [*event.height, *event.prominence]
    size = 1 + _EVENT * _MOST_EVENTS
    reported += [0.0] * (size - len(reported))
    events = reals(bytes(8 * size))
    return Case.of(
        "peaks", 0.3e-12, 1000, events, lows, highs, after=[reals(reported), lows, highs]
    )


def _encoded(lows: array[float], highs: array[float], finest: int) -> Case:
    columns = SAMPLES // _ROWS
    exponent, offset, codes = encode(lows, highs, _ROWS, columns, 0, (), finest)
    reported = reals([exponent, offset, len(codes)])
    return Case.of(
        "encode_frame", _ROWS, columns, finest, lows, highs, bytes(len(codes)), reals([0.0] * 3),
        after=[lows, highs, codes, reported],
    )  # fmt: skip


class _Numbers:
    def __init__(self, sequence: int) -> None:
        self._sequence = sequence

    def next_sequence(self) -> int:
        return self._sequence


_COVERAGE: Final = 0.9973
_TIME: Final = 1_790_000_000_000_000_000, 1_790_000_000_004_000_000
_BOOT: Final = 1_790_000_000
_SEQUENCE: Final = 123_456
_LAYOUT: Final = bytes(range(32))
_PLACE: Final = 3, 1
"""Patch and column."""


def _peak_messages(lows: array[float], highs: array[float]) -> Iterator[Case]:
    detector = PeakDetector(0.3e-12, 1000)
    for event in [*detector.feed(lows, highs, SAMPLES), *detector.gap(0)]:
        stated = event.verdict, event.count, event.height, event.prominence
        writer = MessageWriter(_BOOT, _Numbers(_SEQUENCE), _LAYOUT)
        made = writer.statements(_TIME, peaks=[(*_PLACE, _TIME, *stated, _COVERAGE)])
        numbers = struct.pack("<4q", _BOOT, _SEQUENCE, *_TIME)
        reported = reals([event.verdict, event.count[1], *event.height, *event.prominence])
        room = bytes(len(made.body))
        given = _LAYOUT, numbers
        yield Case.of(
            "peak", *given, _COVERAGE, reported, room, after=[*given, reported, made.body]
        )


def _sealed(length: int) -> Case:
    """A message in AES-256-GCM, as the firmware's COSE envelope has it."""
    secret, nonce, aad = bytes(range(32)), bytes(range(12)), bytes(range(64))
    text = bytes(k * 7 % 256 for k in range(length))
    sealed = AESGCM(secret).encrypt(nonce, text, aad)
    given = secret, nonce, aad
    after = [*given, sealed[:length], sealed[length:]]
    return Case.of("sealing", *given, text, bytes(16), after=after)
