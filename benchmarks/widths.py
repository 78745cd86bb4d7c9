"""How wide the packaged hand's pads measure what presses them: `python -m benchmarks.widths`.

Runs the node's firmware on the scenario as fast as it goes, and looks at the truth of every sample.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from eskin_sensor_node.firmware.message_writer import FRAME
from eskin_sensor_node.machine.flash.flash import Flash
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.node.factory import build_node, build_outbox, chip_key
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.settings import NodeSettings

from eskin.wire.frames import Frame

if TYPE_CHECKING:
    from eskin.interval import Floats, Interval

_SECONDS: Final = 20
_BILLION: Final = 1_000_000_000
_TOUCHED: Final = 3000.0
"""Pa from which on a pad counts as pressed."""
_ALL: Final = 8
_VARIANTS: Final[dict[str, dict[str, Any]]] = {
    "as packaged": {},
    "neighbours' readings not taken into account": {"doubtful_neighbours": _ALL},
    "nor the air's": {"doubtful_neighbours": _ALL, "thermometer": None, "hygrometer": None},
}
_SHOWN: Final = (("pressure", 1e-3, "kPa"), ("contact_area", 1e4, "cm2"))


def measured(folder: Path, changes: dict[str, Any]) -> dict[str, list[tuple[Interval, Floats]]]:
    """Intervals and truth by quantity, frame by frame, of all pads."""
    tables = [
        {key: value for key, value in (each | changes).items() if value is not None}
        if each["kind"] == "pad"
        else each
        for each in Profile.read("hand").taxels
    ]
    given: dict[str, Any] = {
        "node": {"name": "hand", "profile": "hand", "seed": 7},
        "identity": {"directory": folder, "site": folder},
        "flash": {"path": folder / "flash", "capacity_bytes": 2**30},
        "truth": {"path": folder / "truth", "limit_bytes": 2**31},
        "taxel": tables,
    }
    settings = NodeSettings(**given)
    flash = Flash(settings.flash.path, node="hand", key=chip_key(settings), epoch=1)
    truth = GroundTruth(settings.truth.path, limit=2**31)
    layout = plan_layout(settings)
    outbox = build_outbox(flash, capacity=2**30, broker=settings.broker, described=layout.described)
    node, _ = build_node(settings, outbox=outbox, truth=truth, start=0)
    node.run_until(_SECONDS * _BILLION)
    found: dict[str, list[tuple[Interval, Floats]]] = {}
    kept = [each.body for each in flash.after((-1, -1), 1_000_000) if each.kind == FRAME]
    frames = [Frame.decode(body) for body in kept]
    truths = GroundTruth.read_frames(
        settings.truth.path, [frame.position for frame in frames], node="hand"
    )
    for frame in frames:
        true, begin = truths[frame.position].values, 0
        for samples, values in zip(frame.patches, frame.values, strict=True):
            patch, size = layout.patches[samples.patch], values.size
            if patch.patch_id.startswith("pad-"):
                pair = values, true[begin : begin + size].reshape(values.shape)
                found.setdefault(patch.quantity, []).append(pair)
            begin += size
    flash.close()
    truth.close()
    return found


def main() -> None:
    """Print a table."""
    for name, changes in _VARIANTS.items():
        with tempfile.TemporaryDirectory() as folder:
            found = measured(Path(folder), changes)
        wrong = sum(int((~i.contains(t)).sum()) for each in found.values() for i, t in each)
        pressed = [true >= _TOUCHED for _, true in found["pressure"]]
        for quantity, scale, unit in _SHOWN:
            widths = [scale * intervals.wid for intervals, _ in found[quantity]]
            below = [scale * (true - intervals.inf) for intervals, true in found[quantity]]
            touched = np.concatenate([w[p] for w, p in zip(widths, pressed, strict=True)])
            missed = np.concatenate([b[p] for b, p in zip(below, pressed, strict=True)])
            print(
                f"{name:45} {quantity:13} mean width {np.concatenate(widths).mean():.3f} {unit}, "
                f"pressed {touched.mean():.3f} {unit}, {missed.mean():.3f} {unit} of it below the "
                f"truth; samples without their truth: {wrong}"
            )


if __name__ == "__main__":
    main()
