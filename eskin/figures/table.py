"""A figure's numbers as CSV: RFC 4180, full precision, the same bytes each time."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from eskin.figures.figure import Floats


def write_table(path: Path, columns: Mapping[str, Floats]) -> None:
    """Write columns of one length below their headers.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        writer.writerows([repr(value) for value in row] for row in rows)
