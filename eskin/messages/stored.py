"""Samples of blocks that were checked when they were stored, also of packs: bounds alone, fast."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
import numpy as np

from eskin.messages.encoding import ENCODINGS, Encoding, Scale, typed_floats
from eskin.messages.pack import Pack, is_pack

if TYPE_CHECKING:
    from eskin.interval import Floats


def read_bounds(data: bytes) -> tuple[Floats, Floats]:
    """The lower and the upper bounds of the samples of a stored block, or of a pack.

    Args:
        data: A block's bytes, as `Block.decode` took them before, or what `pack` made of several.
    """
    if is_pack(data):
        return Pack.read(data).bounds()
    fields = cbor2.loads(data)
    encoding, lo, hi = ENCODINGS[fields[11]], fields[12].value, fields[13].value
    if encoding is Encoding.Q16:
        scale = Scale(fields[15], fields[16])
        codes = np.frombuffer(lo, "<u2"), np.frombuffer(hi, "<u2")
        return scale.values(codes[0], -np.inf), scale.values(codes[1], np.inf)
    return typed_floats(lo, encoding), typed_floats(hi, encoding)
