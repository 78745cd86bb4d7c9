"""The table of what was measured, for people and as ``build/bench.json``."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Row:
    """One figure.

    Attributes:
        name: What was measured.
        value: The figure.
        unit: Its unit.
        peer: What it is compared with in the same run, if anything.
        peer_value: The peer's figure.
        ratio: How much better than the peer; higher is better.
        target: What the ratio, or without a peer the value, must reach.
        met: Whether it does; ``None`` where there is no target.
    """

    name: str
    value: float
    unit: str
    peer: str | None = None
    peer_value: float | None = None
    ratio: float | None = None
    target: float | None = None
    met: bool | None = None


def at_most(name: str, value: float, unit: str, most: float) -> Row:
    """A figure that must not exceed a bound; its ratio is how far it stays below."""
    ratio = most / value if value else None
    return Row(name, value, unit, ratio=ratio, target=1.0, met=value <= most)


def at_least(name: str, value: float, unit: str, least: float) -> Row:
    """A figure that must reach a bound."""
    return Row(name, value, unit, target=least, met=value >= least)


def write_json(rows: Sequence[Row], path: Path) -> None:
    """Write all rows as a JSON list."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n")


def as_table(rows: Sequence[Row]) -> Table:
    """All rows for the terminal."""
    table = Table(title="eskin bench")
    table.add_column("figure", no_wrap=True)
    for heading in ("value", "unit", "peer", "peer's value", "ratio", "target", "met"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            row.name,
            f"{row.value:,.4g}",
            row.unit,
            row.peer or "-",
            _shown(row.peer_value),
            _shown(row.ratio),
            _shown(row.target),
            "-" if row.met is None else "yes" if row.met else "NO",
        )
    return table


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:,.4g}"
