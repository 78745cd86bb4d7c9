"""What a node has said, channel by channel: samples, peaks and gaps of its frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.tube import Tube
from eskin.wire.frames import Frame, Statements
from eskin.wire.messages import Kind, decode_message
from eskin.wire.messages.cbor_map import load

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from eskin_sensor_node.firmware.chip import StoredMessage
    from eskin_sensor_node.node.ground_truth import TrueFrame

    from eskin.interval import Floats, Verdict
    from eskin.wire.frames import Gap, Patch
    from eskin.wire.messages import Message, Position
    from tests.unit.sensor_node.designs import Bench


@dataclass(frozen=True)
class Samples:
    """Samples of a channel that follow each other in one frame.

    Attributes:
        position: The frame's.
        channel: ``{taxel}.{quantity}``.
        ticks: Of the first one, ns.
        tube: The samples.
        truth: True values behind them; empty where they are not known.
        time: True UTC of the frame's first instant, ns; 0 where it is not known.
    """

    position: Position
    channel: str
    ticks: int
    tube: Tube
    truth: Floats
    time: int

    def hold_truth(self) -> bool:
        """Whether each interval holds the truth, which is known."""
        return len(self.truth) == len(self.tube) and bool(
            np.all(self.tube.values.contains(self.truth))
        )


@dataclass(frozen=True)
class StatedPeak:
    """A peak, with the name of its channel."""

    position: Position
    channel: str
    time: tuple[int, int]
    verdict: Verdict
    count: tuple[int, int]
    height: tuple[float, float]
    prominence: tuple[float, float]
    coverage: float


def decode(body: bytes) -> Message | Frame | Statements:
    """Read any message of a node."""
    fields = load(body)
    kind = fields.integer(1, 0, max(Kind))
    if kind == Kind.FRAME:
        return Frame.read(fields)
    return Statements.read(fields) if kind == Kind.STATEMENTS else decode_message(body)


def frames_of(bodies: Iterable[bytes]) -> list[Frame]:
    """The frames among messages."""
    return [found for found in map(decode, bodies) if isinstance(found, Frame)]


def statements_of(bodies: Iterable[bytes]) -> list[Statements]:
    """The statements among messages."""
    return [found for found in map(decode, bodies) if isinstance(found, Statements)]


def true_frames(bench: Bench, frames: Sequence[Frame]) -> dict[Position, TrueFrame]:
    """The truth behind frames of a node."""
    path, name = bench.settings.truth.path, bench.settings.node.name
    return GroundTruth.read_frames(path, [frame.position for frame in frames], node=name)


def samples_of(bench: Bench, channel: str | None = None) -> list[Samples]:
    """Samples in a node's flash: frame by frame, channel by channel."""
    frames = frames_of(bench.bodies())
    known = true_frames(bench, frames)
    patches = bench.node.layout.patches
    found = (each for frame in frames for each in split(frame, patches, known.get(frame.position)))
    return [each for each in found if channel in (None, each.channel)]


def split(frame: Frame, patches: Sequence[Patch], truth: TrueFrame | None) -> Iterator[Samples]:
    """The samples of a frame, channel by channel; those that are not sent are left out."""
    begin = 0
    for encoded, values in zip(frame.patches, frame.values, strict=True):
        patch, grid = patches[encoded.patch], frame.grids[encoded.grid]
        there = encoded.sampling(grid).mask
        true = None
        if truth is not None:
            true = truth.values[begin : begin + there.size].reshape(there.shape)
            there &= ~np.isnan(true)
        begin += there.size
        for column, taxel in enumerate(patch.taxels):
            step = 1 << encoded.strides[column] if encoded.strides else 1
            rows = np.flatnonzero(there[:, column])
            cuts = np.flatnonzero(np.diff(rows) != step) + 1
            for own in np.split(rows, cuts) if rows.size else ():
                since = grid.delay + int(own[0]) * grid.period
                yield Samples(
                    frame.position,
                    f"{taxel}.{patch.quantity}",
                    frame.ticks + since,
                    Tube(
                        (frame.time[0] + since, frame.time[1] + since),
                        grid.period * step,
                        values[own, column],
                        patch.unit,
                        grid.coverage,
                    ),
                    np.empty(0) if true is None else true[own, column],
                    0 if truth is None else truth.time + since,
                )


def peaks_of(bench: Bench, channel: str | None = None) -> list[StatedPeak]:
    """Peaks in a node's flash."""
    patches = bench.node.layout.patches
    found = []
    for statements in statements_of(bench.bodies()):
        for peak in statements.peaks:
            patch = patches[peak.patch]
            name = f"{patch.taxels[peak.column]}.{patch.quantity}"
            found.append(StatedPeak(statements.position, name, *peak[2:]))
    return [each for each in found if channel in (None, each.channel)]


def stated_gaps(kept: StoredMessage) -> tuple[Gap, ...]:
    """The gaps that a message of a flash states."""
    return Statements.decode(kept.body).gaps if kept.kind == Kind.STATEMENTS else ()


def gaps_of(bench: Bench) -> list[Gap]:
    """Gaps in a node's flash."""
    return [gap for each in statements_of(bench.bodies()) for gap in each.gaps]


def assert_truth_is_inside(found: Sequence[Samples]) -> None:
    """Check that samples hold the truth, which is known."""
    assert found
    for each in found:
        assert each.hold_truth(), (each.channel, each.ticks)
