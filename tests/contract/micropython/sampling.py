"""Lets the firmware encode matrices of samples; runs under CPython and MicroPython alike."""

import struct

from eskin_sensor_node.firmware.sample_codec import Sampling, encode_samples, finest_exponent

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any


def encode(job: "Mapping[str, Any]") -> "list[Any]":
    """Give exponent, offset (as a text) and codes of each matrix.

    ``matrices`` holds for each one its rows, columns, number of the first row (a text), strides,
    least width and bounds; floats as hexadecimal of float64, little endian.
    """
    encoded = []
    for rows, columns, first_row, strides, width, lows, highs in job["matrices"]:
        sampling = Sampling(rows, columns, int(first_row), strides)
        finest = finest_exponent(_reals(width)[0])
        exponent, offset, codes = encode_samples(_reals(lows), _reals(highs), sampling, finest)
        encoded.append([exponent, str(offset), codes.hex()])
    return encoded


def _reals(text: str) -> "tuple[float, ...]":
    data = bytes.fromhex(text)
    return struct.unpack("<%dd" % (len(data) // 8), data)  # noqa: UP031 - a decimal of an integer
