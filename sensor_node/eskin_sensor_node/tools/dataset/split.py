"""The files of one part of a dataset: the same rows as Parquet and as CSV."""

from __future__ import annotations

import hashlib
from collections import Counter
from contextlib import ExitStack
from typing import TYPE_CHECKING, Self

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

_PART = ".part"


class Split:
    """Writes train or test. The files get their names when all is written.

    Args:
        folder: Where they stand.
        name: ``train`` or ``test``.
        schema: Their columns.

    Attributes:
        rows: How many were written.
        labels: How many of each label.
        files: The files.
    """

    def __init__(self, folder: Path, name: str, schema: pa.Schema) -> None:
        self.rows = 0
        self.labels: Counter[str] = Counter()
        self.files = (folder / f"{name}.parquet", folder / f"{name}.csv")
        self._schema = schema
        self._open = ExitStack()

    def __enter__(self) -> Self:
        parquet, text = (file.with_name(file.name + _PART) for file in self.files)
        self._parquet = self._open.enter_context(
            pyarrow.parquet.ParquetWriter(parquet, self._schema, compression="zstd")
        )
        options = pyarrow.csv.WriteOptions(quoting_style="needed")
        self._csv = self._open.enter_context(
            pyarrow.csv.CSVWriter(text, self._schema, write_options=options)
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._open.close()
        finally:
            for file in self.files:
                part = file.with_name(file.name + _PART)
                if kind is None:
                    part.replace(file)
                else:
                    part.unlink(missing_ok=True)

    def write(self, batch: pa.RecordBatch) -> None:
        """Add rows."""
        self._parquet.write_batch(batch)
        self._csv.write_batch(batch)
        self.rows += batch.num_rows
        for entry in batch.column("label").value_counts().to_pylist():
            self.labels[entry["values"]] += entry["counts"]


def fingerprint(file: Path) -> str:
    """SHA-256 of a file."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
