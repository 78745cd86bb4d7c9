"""Messages as nodes would say them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Final

import cbor2
import numpy as np

from eskin.interval import Interval, Verdict
from eskin.tube import Tube
from eskin.wire.biometric import is_biometric
from eskin.wire.frames import (
    Because,
    Frame,
    Gap,
    Grid,
    Layout,
    MonitorVerdict,
    Patch,
    PatchSamples,
    Peak,
    Privacy,
    Statements,
)
from eskin.wire.messages import Position, Status
from eskin.wire.messages.cbor_map import dump

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

NODE: Final = "fingertip"
CHANNEL: Final = "t01.capacitance"
START: Final = 1_800_000_000_000_000_000
DT: Final = 1_000_000
LEAST_WIDTH: Final = 2.0**-64
"""So fine that the hull of a frame's samples sets its quantum: 24 bits a bound."""
SKINS: Final[dict[bytes, tuple[Layout, Patch]]] = {}
"""All skins of one channel that `skin_of` made, by the hash of their layout."""


@lru_cache(None)
def skin_of(
    channel: str = CHANNEL, unit: str = "F", finest: float = LEAST_WIDTH
) -> tuple[Layout, Patch]:
    """A skin of one channel; `put`, `bring` and `Stand.ingest` present it ahead of its frames.

    Args:
        channel: The channel.
        unit: Its unit.
        finest: Least width that the patch states.
    """
    taxel, _, quantity = channel.partition(".")
    worn = (Privacy.BIOMETRIC, "wearer") if is_biometric(channel) else ()
    patch = Patch(f"{taxel}-{quantity}"[:31], quantity, unit, (taxel,), finest, *worn)
    layout = Layout((patch.content_hash,), (1,))
    SKINS[layout.content_hash] = layout, patch
    return layout, patch


def stretch(
    sequence: int,
    lo: ArrayLike = (1.0,),
    hi: ArrayLike = (2.0,),
    *,
    boot: int = 1,
    time: tuple[int, int] = (START, START),
    dt: int = DT,
    channel: str = CHANNEL,
    unit: str = "F",
    coverage: float = 1.0,
    finest: float = LEAST_WIDTH,
) -> Frame:
    """A frame of one channel, of at most 1000 samples."""
    values = Interval(np.asarray(lo, np.float64), np.asarray(hi, np.float64)).reshape(-1, 1)
    layout, patch = skin_of(channel, unit, finest)
    return Frame(
        Position(boot, sequence),
        layout.content_hash,
        0,
        max(time[0] - START, 0),
        time,
        (Grid(0, dt, 0, values.shape[0], coverage),),
        (PatchSamples.pack(values, patch.least_width, patch=0, grid=0, first_row=0),),
    )


def tube_of(said: Frame) -> Tube:
    """The samples of a frame of one channel, as it states them."""
    grid = said.grids[0]
    earliest, latest = said.time
    time = earliest + grid.delay, latest + grid.delay
    unit = SKINS[said.layout][1].unit
    return Tube(time, grid.period, said.values[0].reshape(-1), unit, grid.coverage)


def lying(said: Frame) -> bytes:
    """A frame's bytes with a byte more than its codes have."""
    fields = cbor2.loads(said.encode())
    fields[9][0][6] += b"\0"
    return dump(fields)


def peak(
    sequence: int,
    *,
    boot: int = 1,
    time: tuple[int, int] = (START, START + 5 * DT),
    verdict: Verdict = Verdict.CERTAIN,
    channel: str = CHANNEL,
    unit: str = "F",
) -> Statements:
    """A peak."""
    counts = (int(verdict is Verdict.CERTAIN), 1)
    found = Peak(0, 0, time, verdict, counts, (2.0, float("inf")), (0.5, 0.75), 0.875)
    layout = skin_of(channel, unit)[0].content_hash
    return Statements(Position(boot, sequence), layout, peaks=(found,))


def gap(
    sequence: int,
    *,
    boot: int = 1,
    time: tuple[int, int] = (START, START + DT),
    lost: tuple[tuple[int, int, int], ...] | None = None,
) -> Statements:
    """A gap; of the messages 0 to 2 unless others are given."""
    spans = ((boot, 0, 2),) if lost is None else lost
    found = Gap("flash full", time, 3, 1500, spans)
    return Statements(Position(boot, sequence), skin_of()[0].content_hash, gaps=(found,))


def verdict(
    sequence: int,
    *stated: tuple[str, Verdict],
    boot: int = 1,
    time: tuple[int, int] = (START, START + DT),
) -> Statements:
    """Verdicts of monitors, given by name, in their order."""
    verdicts = tuple(
        MonitorVerdict(
            monitor,
            time,
            each,
            final=True,
            because=Because.WIDTH if each is Verdict.POSSIBLE else Because(0),
            coverage=0.75,
        )
        for monitor, each in stated
    )
    return Statements(Position(boot, sequence), skin_of()[0].content_hash, verdicts=verdicts)


def status(sequence: int, *, boot: int = 1) -> Status:
    """A status."""
    return Status(
        Position(boot, sequence),
        (START, START + 10),
        "fingertip",
        "one finger",
        5 * 10**9,
        2,
        4096,
        1_048_576,
        1,
    )
