"""The contacts of a skin at one instant."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, Final, TypeVar, overload

import numpy as np

from eskin.contacts.components import classify, label_components
from eskin.contacts.count import add_free_contacts
from eskin.contacts.measures import add_up_components, bound_centroids
from eskin.contacts.skin import AXES
from eskin.errors import ContactError, IntervalError
from eskin.interval import Interval, Verdict, require_plain
from eskin.interval.conversion import as_compiled, enclose, first_index
from eskin.interval.markup import html_table
from eskin.kernels.rounding_mode import rounding_to_nearest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike, NDArray

    from eskin.contacts.components import Indices
    from eskin.contacts.skin import Skin
    from eskin.interval import Floats

Row_co = TypeVar("Row_co", covariant=True)

REGION: Final = np.dtype(
    [
        ("cores", np.int64),
        ("cells", np.int64),
        ("fewest", np.int64),
        ("most", np.int64),
        ("exact", np.bool_),
        ("area_sup", np.float64),
        ("force_sup", np.float64),
    ]
)
"""One row of `Regions.table`; the columns are explained at `Region`."""


class Rows(Sequence[Row_co]):
    """A sequence of objects, kept as one structured array: a noisy skin has thousands.

    Attributes:
        table: One row for each object.
    """

    __slots__ = ("table",)
    table: NDArray[np.void]

    @abstractmethod
    def _row(self, number: int, *columns: Any) -> Row_co:
        """The object of a row."""

    def __len__(self) -> int:
        return len(self.table)

    @overload
    def __getitem__(self, index: int) -> Row_co: ...
    @overload
    def __getitem__(self, index: slice) -> list[Row_co]: ...
    def __getitem__(self, index: int | slice) -> Row_co | list[Row_co]:
        numbers = range(len(self.table))[index]
        if isinstance(numbers, range):
            return [self._row(k, *self.table[k].item()) for k in numbers]
        return self._row(numbers, *self.table[numbers].item())

    def __iter__(self) -> Iterator[Row_co]:
        return (self._row(k, *row) for k, row in enumerate(self.table.tolist()))


@dataclass(frozen=True, slots=True)
class Contact:
    """The contact of one core: the connected pressed taxels that hold it, whichever they are.

    Attributes:
        core: Number of the core at this instant.
        region: Number of its region.
        cells: Fewest and most taxels.
        area: Least and greatest area, in m².
        force: Least and greatest normal force, in N; ``inf`` where a pressure has no upper bound.
        centroid: For each coordinate the least and the greatest centroid of its area, in m. They
            enclose those of all sets between core and region; not each of them is connected.
    """

    core: int
    region: int
    cells: tuple[int, int]
    area: tuple[float, float]
    force: tuple[float, float]
    centroid: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Region:
    """Connected taxels that are possibly pressed; no contact reaches beyond.

    Attributes:
        verdict: Whether a contact is in it: certain if it has a core, else possible.
        cores: Number of its cores.
        cells: Number of its taxels.
        count: Fewest and most contacts in it.
        exact: Whether so many as the most are possible. If not, it is only known that there are
            not more.
        area: Greatest area of a contact in it, in m².
        force: Greatest normal force of a contact in it, in N.
    """

    verdict: Verdict
    cores: int
    cells: int
    count: tuple[int, int]
    exact: bool
    area: float
    force: float


class Regions(Rows[Region]):
    """Regions in order of their lowest taxel: a sequence of `Region`.

    Attributes:
        table: One row for each, with the columns ``cores``, ``cells``, ``fewest``, ``most``,
            ``exact``, ``area_sup``, ``force_sup`` (see `Region`).
    """

    __slots__ = ()

    def __init__(self, table: NDArray[np.void]) -> None:
        self.table = table

    def __repr__(self) -> str:
        fewest, most = self.total
        return f"Regions({len(self)} regions, {fewest} to {most} contacts)"

    @property
    def total(self) -> tuple[int, int]:
        """Fewest and most contacts in all of them."""
        return int(self.table["fewest"].sum()), int(self.table["most"].sum())

    @property
    def possible(self) -> Regions:
        """Those without a core: possible contacts."""
        return Regions(self.table[self.table["cores"] == 0])

    def _row(self, _: int, /, *columns: Any) -> Region:
        cores, cells, fewest, most, exact, area, force = columns
        verdict = Verdict.CERTAIN if cores else Verdict.POSSIBLE
        return Region(verdict, cores, cells, (fewest, most), exact, area, force)


class Contacts(Rows[Contact]):
    """What is known of a skin's contacts at one instant: a sequence of its cores' contacts.

    Attributes:
        table: One row for each core, in order of its lowest taxel: ``region``, ``cells_inf``,
            ``cells_sup``, ``area_inf``, ``area_sup``, ``force_inf``, ``force_sup``, ``x_inf``,
            ``x_sup``, and so on for each coordinate (see `Contact`).
        regions: All regions; ``regions.possible`` has those without a core.
        core_of: Number of each taxel's core, -1 where it is in none, shape ``(n,)``.
        region_of: Number of each taxel's region, -1 where it is in none, shape ``(n,)``.
    """

    __slots__ = ("core_of", "region_of", "regions")

    def __init__(
        self, table: NDArray[np.void], regions: Regions, core_of: Indices, region_of: Indices
    ) -> None:
        self.table = table
        self.regions = regions
        self.core_of = core_of
        self.region_of = region_of

    def __repr__(self) -> str:
        fewest, most = self.total
        return (
            f"Contacts({len(self)} cores in {len(self.regions)} regions, "
            f"{fewest} to {most} contacts)"
        )

    def _repr_html_(self) -> str:
        def row(k: int) -> list[str]:
            each = self[k]
            place = ", ".join(f"{Interval(*bounds):.3g}" for bounds in each.centroid)
            return [
                str(each.core), str(each.region), f"{each.cells[0]} to {each.cells[1]}",
                f"{Interval(*each.area):.3g}", f"{Interval(*each.force):.3g}", place,
            ]  # fmt: skip

        fewest, most = self.total
        caption = f"{fewest} to {most} contacts; {len(self.regions.possible)} regions have no core"
        heads = ["core", "region", "taxels", "area in m²", "force in N", "centroid in m"]
        return html_table(caption, heads, len(self), row)

    @property
    def total(self) -> tuple[int, int]:
        """Fewest and most contacts on the skin."""
        return self.regions.total

    def joined(self, one: int, other: int) -> Verdict:
        """Whether two cores belong to one contact.

        That is possible if they share a region, impossible if not, and certain of a core with
        itself only.

        Raises:
            IndexError: There is no core of this number.
        """
        cores = range(len(self))
        if cores[one] == cores[other]:
            return Verdict.CERTAIN
        regions = self.table["region"]
        return Verdict.POSSIBLE if regions[one] == regions[other] else Verdict.IMPOSSIBLE

    def _row(self, number: int, /, *columns: Any) -> Contact:
        region, *bounds = columns
        cells, area, force, *centroid = zip(bounds[::2], bounds[1::2], strict=True)
        return Contact(number, region, cells, area, force, tuple(centroid))


def find_contacts(lo: ArrayLike, hi: ArrayLike, skin: Skin, threshold: float) -> Contacts:
    """The contacts of a skin at one instant.

    A taxel is pressed where its pressure exceeds the threshold, and a contact is a connected
    component of the pressed taxels. `eskin.contacts` states what is certain of them.

    Args:
        lo: Lower bounds of the pressures in Pa, shape ``(n,)``; ``-inf`` or NaN where unknown.
        hi: Upper bounds in Pa, shape ``(n,)``; ``inf`` or NaN where unknown.
        skin: The n taxels.
        threshold: Pressure in Pa above which a taxel is pressed, positive and finite.

    Raises:
        ContactError: The threshold is not positive and finite.
        IntervalError: Bounds are no intervals, or not one for each taxel, or carry a unit.
    """
    above = require_threshold(threshold)
    return search(*pressures_of(lo, hi, (len(skin),)), skin, above)


def require_threshold(threshold: float) -> float:
    """Check a threshold.

    Raises:
        ContactError: It is not positive and finite, or carries a unit.
    """
    require_plain(threshold, "threshold", ContactError)
    if not 0.0 < threshold < inf:
        raise ContactError(
            f"threshold is {threshold} Pa; it must be positive and finite: at zero each taxel "
            "whose interval reaches above zero could be pressed, and that is the whole skin"
        )
    return float(threshold)


def pressures_of(lo: ArrayLike, hi: ArrayLike, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Bounds of a given shape, as kernels take them.

    Raises:
        IntervalError: They are no intervals, or have another shape.
    """
    lows, highs = enclose(lo, "lo")[0], enclose(hi, "hi")[1]
    for name, side in (("lo", lows), ("hi", highs)):
        if side.shape != shape:
            raise IntervalError(
                f"{name} has shape {side.shape}, and {shape} is needed: one pressure a taxel"
            )
    wrong = (lows > highs) | (lows == inf) | (highs == -inf)
    if wrong.any():
        where = first_index(wrong)
        raise IntervalError(
            f"pressure at index {where} is no interval: lo={float(lows[where])!r}, "
            f"hi={float(highs[where])!r}; lo <= hi is needed, or NaN for an unknown side"
        )
    return as_compiled(lows), as_compiled(highs)


@rounding_to_nearest
def search(lo: Floats, hi: Floats, skin: Skin, threshold: float) -> Contacts:
    """`find_contacts`, of what was checked."""
    count = len(skin)
    certain, possible = np.empty((2, count), np.bool_)
    classify(lo, hi, threshold, certain, possible)
    core_of, region_of = np.empty((2, count), np.int64)
    regions = np.zeros(label_components(possible, skin.starts, skin.neighbours, region_of), REGION)
    table = np.empty(
        label_components(certain, skin.starts, skin.neighbours, core_of), core_type(skin)
    )
    _measure_regions(regions, region_of, hi, skin)
    _measure_cores(table, regions, core_of, region_of, lo, skin)
    region_of_core = table["region"]
    regions["cores"] = np.bincount(region_of_core, minlength=len(regions))
    regions["fewest"] = regions["cores"] > 0
    most, exact = regions["cores"].copy(), np.ones(len(regions), np.bool_)
    add_free_contacts(certain, region_of, skin.starts, skin.neighbours, most, exact)
    regions["most"], regions["exact"] = most, exact
    return Contacts(table, Regions(regions), core_of, region_of)


def core_type(skin: Skin) -> np.dtype[np.void]:
    """A row of `Contacts.table`."""
    bounds = [f"{name}_{side}" for name in ("area", "force") for side in ("inf", "sup")]
    places = [f"{name}_{side}" for name in AXES[: skin.dimensions] for side in ("inf", "sup")]
    whole = [(name, np.int64) for name in ("region", "cells_inf", "cells_sup")]
    return np.dtype(whole + [(name, np.float64) for name in bounds + places])


def _measure_regions(regions: NDArray[np.void], region_of: Indices, hi: Floats, skin: Skin) -> None:
    cells, areas, forces = _measure(region_of, len(regions), hi, skin, 1.0)
    regions["cells"], regions["area_sup"], regions["force_sup"] = cells, areas, forces


def _measure_cores(
    table: NDArray[np.void],
    regions: NDArray[np.void],
    core_of: Indices,
    region_of: Indices,
    lo: Floats,
    skin: Skin,
) -> None:
    if len(table) == 0:
        return
    cells, areas, forces = _measure(core_of, len(table), lo, skin, -1.0)
    table["cells_inf"], table["area_inf"], table["force_inf"] = cells, areas, forces
    region_of_core = np.empty(len(table), np.int64)
    inside = core_of >= 0
    region_of_core[core_of[inside]] = region_of[inside]
    table["region"] = region_of_core
    for name in ("cells", "area_sup", "force_sup"):
        own = "cells_sup" if name == "cells" else name
        table[own] = regions[name][region_of_core]
    bounds = np.empty(len(table))
    for axis, name in enumerate(AXES[: skin.dimensions]):
        coordinates = np.ascontiguousarray(skin.positions[:, axis])
        rising = skin.by_coordinate(axis)
        for side, order, sign in (("inf", rising, -1.0), ("sup", rising[::-1].copy(), 1.0)):
            bound_centroids(
                coordinates, order, skin.area, region_of, core_of, region_of_core, sign, bounds
            )
            table[f"{name}_{side}"] = bounds


def _measure(
    labels: Indices, count: int, pressure: Floats, skin: Skin, sign: float
) -> tuple[Indices, Floats, Floats]:
    cells, (areas, forces) = np.empty(count, np.int64), np.empty((2, count))
    add_up_components(labels, skin.area, pressure, sign, cells, areas, forces)
    return cells, areas, forces
