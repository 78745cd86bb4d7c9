"""Compiles what the firmware calculates with, ahead of time: it takes seconds, once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter

from sensor_node.firmware.inversion import build_inversion
from sensor_node.profile import Profile, profile_names
from sensor_node.taxels import Taxel

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sensor_node.taxels import AnyTaxel


def compile_firmware(taxels: Iterable[AnyTaxel]) -> None:
    """Compile for some taxels; what is compiled is cached on disk."""
    codes = np.zeros(1, dtype=np.int64)
    for taxel in taxels:
        build_inversion(taxel).measure({"current": codes, "voltage": codes})


def compile_profiles() -> None:
    """Compile for every packaged profile, as images do when they are built."""
    adapter = TypeAdapter(tuple[Taxel, ...])
    for name in profile_names():
        compile_firmware(adapter.validate_python(Profile.read(name).taxels))
