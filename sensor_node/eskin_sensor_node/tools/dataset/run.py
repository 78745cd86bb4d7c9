"""One run of a dataset: a scenario played with one seed, as rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa

from eskin.interval import Interval
from eskin_sensor_node.kinds.coil.physics import Coils
from eskin_sensor_node.kinds.pad.physics import Pads
from eskin_sensor_node.tools.dataset.columns import HI, LO, SURROUNDINGS, TRUE, schema
from eskin_sensor_node.tools.dataset.measurement import Chains, SkinInversion
from eskin_sensor_node.world.scenario import LABELS, Stage

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.tools.dataset.plan import Plan
    from eskin_sensor_node.world.scenario import Stimulus

_ROWS: Final = 1 << 18
"""Of a batch: what fits into memory with ease."""
_PAD_PARTS, _PAD_NOISE, _COIL_PARTS, _COIL_NOISE, _AROUND_PARTS, _AROUND_NOISE = range(1, 7)

Columns = dict[str, "Floats"]


class Run:
    """Plays a plan with one seed; the same seed gives the same rows.

    Args:
        plan: What is made.
        seed: Draws variations, true parts and noise.
    """

    def __init__(self, plan: Plan, seed: int) -> None:
        self._plan = plan
        self._seed = seed
        script, n = plan.script, len(plan.pads)
        stage = Stage(script, seed=seed)
        self._names = np.array(stage.skin.names, dtype=object)
        parts = self._randoms(_PAD_PARTS, n)
        self._pads = Pads.draw(plan.pads, parts, stage=stage, faults=script.fault)
        self._pad_chains = Chains(plan.pads, parts, self._randoms(_PAD_NOISE, n))
        broken = [stage.skin.numbers[fault.taxel] for fault in script.fault]
        self._inversion = SkinInversion(
            plan.pads[0], stage.skin.neighbours, crosstalk=script.skin.crosstalk, broken=broken
        )
        self._coils: Coils | None = None
        if plan.coils:
            parts = self._randoms(_COIL_PARTS, n)
            self._coils = Coils(plan.coils, parts, stage=stage, faults=script.fault)
            self._coil_chains = Chains(plan.coils, parts, self._randoms(_COIL_NOISE, n))
        self._broken = broken
        sensors: list[TaxelSection] = [plan.thermometer, plan.hygrometer, plan.electrode]
        parts, noises = (self._randoms(each, 3) for each in (_AROUND_PARTS, _AROUND_NOISE))
        self._around = [
            Chains([sensor], [parts[k]], [noises[k]]) for k, sensor in enumerate(sensors)
        ]

    def batches(self) -> Iterator[pa.RecordBatch]:
        """Its rows, ordered by time and then by taxel, in pieces of equal times."""
        times = self._plan.seconds
        step = max(1, _ROWS // len(self._names))
        for first in range(0, len(times), step):
            yield self._batch(times[first : first + step])

    def _batch(self, seconds: Floats) -> pa.RecordBatch:
        true, stimulus = self._pads.truth(seconds)
        air_true, air = self._surroundings(stimulus)
        measured = self._pad_chains.measure({"capacitance": true["capacitance"]})[1]
        contacts = self._inversion.infer(
            measured["capacitance"], air["temperature"], air["humidity"]
        )
        truth, intervals = true | air_true, measured | contacts | air
        if self._coils is not None:
            coil_true, _ = self._coils.truth(seconds)
            chain, seen = self._coil_chains.measure(
                {name: coil_true[name] for name in ("inductance", "conductance", "susceptance")}
            )
            truth, intervals = truth | coil_true | chain, intervals | self._believed(seen)
        return self._rows(seconds, stimulus, truth, intervals)

    def _rows(
        self,
        seconds: Floats,
        stimulus: Stimulus,
        truth: Columns,
        intervals: dict[str, Interval],
    ) -> pa.RecordBatch:
        shape = len(self._names), len(seconds)
        columns: dict[str, Any] = {
            "run": np.full(shape[0] * shape[1], self._seed, dtype=np.int64),
            "time_s": _flat(seconds, shape),
            "taxel": np.tile(self._names, len(seconds)),
            "label": np.array(LABELS, dtype=object)[stimulus.labels.T.ravel()],
            "fault": self._faults(seconds).T.ravel(),
        }
        for quantity in self._plan.quantities:
            columns[quantity.column(TRUE)] = _flat(truth[quantity.name], shape)
            columns[quantity.column(LO)] = _flat(intervals[quantity.name].inf, shape)
            columns[quantity.column(HI)] = _flat(intervals[quantity.name].sup, shape)
        return pa.RecordBatch.from_pydict(columns, schema=schema(self._plan.quantities))

    def _surroundings(self, stimulus: Stimulus) -> tuple[Columns, dict[str, Interval]]:
        """Readings of the ambient sensors: one of each, which all taxels read along."""
        truth = {each.name: getattr(stimulus, each.name)[None, :] for each in SURROUNDINGS}
        read: dict[str, Interval] = {}
        for chains in self._around:
            read |= chains.measure(truth)[1]
        return truth, read

    def _believed(self, seen: dict[str, Interval]) -> dict[str, Interval]:
        """Nothing is known of the metal before a broken coil."""
        lo, hi = seen["distance"].inf.copy(), seen["distance"].sup.copy()
        lo[self._broken], hi[self._broken] = -np.inf, np.inf
        return seen | {"distance": Interval(lo, hi)}

    def _faults(self, seconds: Floats) -> Any:
        found = np.full((len(self._names), len(seconds)), "none", dtype=object)
        for row, fault in zip(self._broken, self._plan.script.fault, strict=True):
            found[row, seconds >= fault.at_s] = fault.kind
        return found

    def _randoms(self, stream: int, n: int) -> list[np.random.Generator]:
        return [np.random.default_rng((self._seed, stream, number)) for number in range(n)]


def _flat(values: Floats, shape: tuple[int, int]) -> Floats:
    """Rows by time and then by taxel."""
    return np.ascontiguousarray(np.broadcast_to(values, shape).T).ravel()
