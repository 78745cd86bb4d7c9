"""Where a replayed taxel finds its signal."""

from __future__ import annotations

from pydantic import Field

from eskin.runtime.settings import Section


class Recorded(Section):
    """What all replayed taxels have."""

    recording: str = Field(description="a CSV or Parquet file; docs/scenarios.md has its columns")
    channel: str = Field(
        pattern=r"^\S+$", description="the file's channel that it takes, such as t05.capacitance"
    )
    scale: float = Field(
        default=1.0, gt=0, description="SI units in one of the file's: 1e-12 for pF"
    )
