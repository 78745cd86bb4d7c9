"""A scenario being played: what happens to which taxel at which time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin_sensor_node.world.scenario.cast import Cast
from eskin_sensor_node.world.scenario.events import AWAY, LABELS
from eskin_sensor_node.world.scenario.stimulus import Stimulus, overlap
from eskin_sensor_node.world.skin.crosstalk import Crosstalk

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.world.scenario.cast import Approach, ContactActor
    from eskin_sensor_node.world.scenario.script import Script
    from eskin_sensor_node.world.skin import HysteresisSection
    from eskin_sensor_node.world.skin.skin import Indices

Mask: TypeAlias = "NDArray[np.bool_]"

_REST_QUALITY: Final = 10.0
_COURSE: Final = 65
"""Instants of a contact among which its greatest pressure is sought."""


class Stage:
    """Plays a scenario for some taxels of its skin; the same for the same seed.

    Args:
        script: The scenario.
        taxels: Names of the taxels; ``None``: all.
        seed: Draws the variations and the crosstalk; ``None``: the scenario's own.
    """

    def __init__(
        self, script: Script, taxels: Sequence[str] | None = None, *, seed: int | None = None
    ) -> None:
        self._script = script
        self.skin = script.skin.build()
        self.seed = script.seed if seed is None else seed
        names = self.skin.names if taxels is None else taxels
        self.places: Indices = np.array([self.skin.numbers[name] for name in names], np.int64)
        crosstalk = Crosstalk.draw(self.skin, script.skin.crosstalk, self.seed)
        # Neighbours count, too, for what they hand on.
        self._crosstalk = crosstalk.among(self.places)
        self._positions = self.skin.positions[self._crosstalk.rows]
        self._casts: dict[int, Cast] = {}

    def stimulus(self, seconds: Floats) -> Stimulus:
        """True causes; what comes before the start is as the start.

        Args:
            seconds: Times since the start; of a single taxel also rows × times, where nodes with
                clocks of their own have it: what is of taxels × times has the same shape then.
        """
        script, times = self._script, seconds.ravel()
        loops, local = script.local(times)
        shape = len(self._positions), len(times)
        play = _Play(self, shape, script.hysteresis)
        for loop in np.unique(loops).tolist():
            play.perform(self._cast(loop), local, loops == loop)
        own, rows = self._crosstalk.places, (-1, seconds.shape[-1])
        return Stimulus(
            covered=np.minimum(play.covered[own], 1.0).reshape(rows),
            pressure=play.pressure[own].reshape(rows),
            felt=(self._crosstalk.felt(play.pressure) + play.remains[own]).reshape(rows),
            metal_distance=play.distance[own].reshape(rows),
            metal_quality=play.quality[own].reshape(rows),
            labels=play.labels[own].reshape(rows),
            temperature=script.ambient.temperature(local).reshape(seconds.shape),
            humidity=script.ambient.humidity(local).reshape(seconds.shape),
            bioelectric=script.bioelectric.voltage(seconds),
        )

    @property
    def positions(self) -> Floats:
        """Where the taxels and their neighbours sit."""
        return self._positions

    def _cast(self, loop: int) -> Cast:
        if loop not in self._casts:
            # Time goes on: loops that are over are not asked for again.
            self._casts = {key: cast for key, cast in self._casts.items() if key == loop - 1}
            random = np.random.default_rng((self.seed, loop))
            self._casts[loop] = Cast.draw(self._script, self.skin, random)
        return self._casts[loop]


class _Play:
    """The causes on the rows of a stage, while they are added up."""

    def __init__(self, stage: Stage, shape: tuple[int, int], hysteresis: HysteresisSection) -> None:
        self._positions = stage.positions
        self._plate = stage.skin.disc_radius
        self._cell = stage.skin.cell_area
        self._hysteresis = hysteresis
        self.covered = np.zeros(shape)
        self.pressure = np.zeros(shape)
        self.remains = np.zeros(shape)
        self.distance = np.full(shape, AWAY)
        self.quality = np.full(shape, _REST_QUALITY)
        self.labels = np.zeros(shape, dtype=np.int8)

    def perform(self, cast: Cast, local: Floats, mask: Mask) -> None:
        """Add what happens in one loop, at the times of a mask."""
        first, last = local[mask].min(), local[mask].max()
        for approach in cast.approaches:
            if approach.meets(first, last):
                self._approach(approach, local, mask & approach.lasts(local))
        for contact in cast.contacts:
            if contact.meets(first, last):
                self._touch(contact, local, mask & contact.lasts(local))
            if self._hysteresis.share > 0.0 and contact.end < last:
                self._remain(contact, local, mask & (local > contact.end))

    def _touch(self, contact: ContactActor, local: Floats, when: Mask) -> None:
        columns = np.flatnonzero(when)
        radius, pressure, centre = contact.patch(local[columns])
        # Far rows stay as they are: most taxels of a large skin.
        near = self._near(centre, float(radius.max(initial=0.0)) + self._plate)
        apart = np.linalg.norm(self._positions[near, None, :] - centre[None], axis=2)
        share = overlap(apart, radius, self._plate) / self._cell
        cells = np.ix_(near, columns)
        self.covered[cells] += share
        self.pressure[cells] += share * pressure
        label = LABELS.index(contact.label)
        self.labels[cells] = np.where(share > 0.0, label, self.labels[cells])

    def _remain(self, contact: ContactActor, local: Floats, when: Mask) -> None:
        """What a contact leaves behind, of its greatest pressure on each taxel."""
        columns = np.flatnonzero(when)
        course = np.linspace(contact.begin, contact.end, _COURSE)
        radius, pressure, centre = contact.patch(course)
        near = self._near(centre, float(radius.max()) + self._plate)
        apart = np.linalg.norm(self._positions[near, None, :] - centre[None], axis=2)
        share = overlap(apart, radius, self._plate) / self._cell
        most = self._hysteresis.share * (share * pressure).max(axis=1, initial=0.0)
        left = np.exp(-(local[columns] - contact.end) / self._hysteresis.decay_s)
        cells = np.ix_(near, columns)
        self.remains[cells] = np.maximum(self.remains[cells], most[:, None] * left)

    def _approach(self, approach: Approach, local: Floats, when: Mask) -> None:
        columns = np.flatnonzero(when)
        metal = approach.position(local[columns])
        apart = np.linalg.norm(self._positions[:, None, :] - metal[None], axis=2)
        nearer = apart < self.distance[:, columns]
        self.quality[:, columns] = np.where(
            nearer, approach.event.quality, self.quality[:, columns]
        )
        self.distance[:, columns] = np.minimum(apart, self.distance[:, columns])
        seen = apart < approach.event.reach_m
        label = LABELS.index(approach.event.LABEL)
        self.labels[:, columns] = np.where(seen, label, self.labels[:, columns])

    def _near(self, centre: Floats, reach: float) -> Indices:
        if len(centre) == 0:
            return np.zeros(0, dtype=np.int64)
        lowest, highest = centre.min(axis=0) - reach, centre.max(axis=0) + reach
        inside = np.all((self._positions >= lowest) & (self._positions <= highest), axis=1)
        return np.flatnonzero(inside)
