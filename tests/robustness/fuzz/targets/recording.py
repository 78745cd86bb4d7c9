"""Recordings, as CSV and as Parquet."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.parquet
from eskin_sensor_node.world.replay.recording import read_recording

from eskin.errors import RecordingError
from tests.robustness.fuzz.mutations.octets import mutate_octets
from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.target import Target
from tests.robustness.fuzz.targets.settings import require_line

if TYPE_CHECKING:
    from pathlib import Path
    from random import Random

_PARQUET = b"PAR1"


def make(folder: Path) -> Target:
    """Only `RecordingError`; what is read rises in time, and has intervals."""
    text, parquet = folder / "recording.csv", folder / "recording.parquet"

    def check(data: bytes) -> None:
        path = parquet if data.startswith(_PARQUET) else text
        path.write_bytes(data)
        try:
            found = read_recording(path)
        except RecordingError as error:
            require_line(str(error))
            return
        for series in found.series.values():
            assert (series.times[1:] > series.times[:-1]).all()
            assert (series.values.inf <= series.values.sup).all()

    rows = {
        "time_ns": [0, 10, 20],
        "channel": ["a"] * 3,
        "lo": [1.0, 2.0, 3.0],
        "hi": [2.0, 3.0, 4.0],
    }
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(pa.table(rows), buffer)
    plain = b"time,channel,value\n0.0,a.x,1.0\n0.001,a.x,1.5\n0.002,a.x,2\n0.009,b.x,3\n"
    bounds = b"time_s,channel,lo,hi\n0.0,a.x,1.0,2.0\n0.001,a.x,-inf,1.5\n"
    return Target((plain, bounds, buffer.getvalue()), _mutate, check)


def _mutate(data: bytes, random: Random) -> bytes:
    return (mutate_octets if data.startswith(_PARQUET) else mutate_text)(data, random)
