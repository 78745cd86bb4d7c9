"""One run of a dataset: a scenario played with one seed, as rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa

from eskin.interval import Interval
from eskin_sensor_node.kinds.coil import CoilWorld
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.pad import PadWorld
from eskin_sensor_node.timebase import BILLION
from eskin_sensor_node.tools.dataset.columns import HI, LO, SURROUNDINGS, TRUE, schema
from eskin_sensor_node.tools.dataset.measurement import Chains, SkinInversion
from eskin_sensor_node.world.scenario import LABELS, Stage

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.tools.dataset.plan import Plan
    from eskin_sensor_node.world.scenario import Stimulus

_ROWS: Final = 1 << 18
"""Of a batch: what fits into memory with ease."""
_PADS, _COILS, _AROUND = 0, 1 << 30, 1 << 31
"""Numbers of the first taxels of each kind."""

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
        random = ColumnGenerator(seed, _PADS + np.arange(n))
        self._pads = PadWorld(plan.pads[0], random, stage.skin.names, stage=stage)
        self._pad_chains = Chains(plan.pads[0], random)
        self._departures = [
            (np.array([stage.skin.numbers[each.taxel]] if each.taxel else range(n)), each)
            for each in script.departures
        ]
        self._inversion = SkinInversion(
            plan.pads[0],
            stage.skin.neighbours,
            crosstalk=script.skin.crosstalk,
            broken=self._departed({"stuck", "dead", "wet"}),
            worn=self._departed({"worn", "hysteresis"}),
        )
        self._coils: CoilWorld | None = None
        if plan.coils:
            random = ColumnGenerator(seed, _COILS + np.arange(n))
            self._coils = CoilWorld(plan.coils[0], random, stage.skin.names, stage=stage)
            self._coil_chains = Chains(plan.coils[0], random)
        self._broken = self._departed({"stuck", "dead"})
        sensors: list[TaxelSection] = [plan.thermometer, plan.hygrometer, plan.electrode]
        self._around = [
            Chains(sensor, ColumnGenerator(seed, _AROUND + k)) for k, sensor in enumerate(sensors)
        ]

    def batches(self) -> Iterator[pa.RecordBatch]:
        """Its rows, ordered by time and then by taxel, in pieces of equal times."""
        times = self._plan.seconds
        step = max(1, _ROWS // len(self._names))
        for first in range(0, len(times), step):
            yield self._batch(times[first : first + step])

    def _batch(self, seconds: Floats) -> pa.RecordBatch:
        true, stimulus = self._pads.truth(seconds)
        instants = np.rint(seconds * BILLION).astype(np.int64)
        air_true, air = self._surroundings(stimulus, instants)
        capacitance = {"capacitance": true["capacitance"]}
        measured = self._pad_chains.measure(capacitance, instants)[1]
        contacts = self._inversion.infer(
            measured["capacitance"], air["temperature"], air["humidity"]
        )
        truth, intervals = true | air_true, measured | contacts | air
        if self._coils is not None:
            coil_true, _ = self._coils.truth(seconds)
            chain, seen = self._coil_chains.measure(
                {name: coil_true[name] for name in ("inductance", "conductance", "susceptance")},
                instants,
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

    def _surroundings(
        self, stimulus: Stimulus, instants: NDArray[np.int64]
    ) -> tuple[Columns, dict[str, Interval]]:
        """Readings of the ambient sensors: one of each, which all taxels read along."""
        truth = {each.name: getattr(stimulus, each.name)[None, :] for each in SURROUNDINGS}
        read: dict[str, Interval] = {}
        for chains in self._around:
            read |= chains.measure(truth, instants)[1]
        return truth, read

    def _believed(self, seen: dict[str, Interval]) -> dict[str, Interval]:
        """Nothing is known of the metal before a broken coil."""
        lo, hi = seen["distance"].inf.copy(), seen["distance"].sup.copy()
        lo[self._broken], hi[self._broken] = -np.inf, np.inf
        return seen | {"distance": Interval(lo, hi)}

    def _departed(self, kinds: set[str]) -> list[int]:
        """Taxels that leave their data sheets at some time."""
        return [int(row) for rows, each in self._departures if each.kind in kinds for row in rows]

    def _faults(self, seconds: Floats) -> Any:
        found = np.full((len(self._names), len(seconds)), "none", dtype=object)
        for rows, each in self._departures:
            when = (seconds >= each.begin_s) & (seconds < each.end_s)
            found[np.ix_(rows, np.flatnonzero(when))] = each.kind
        return found


def _flat(values: Floats, shape: tuple[int, int]) -> Floats:
    """Rows by time and then by taxel."""
    return np.ascontiguousarray(np.broadcast_to(values, shape).T).ravel()
