"""All figures, drawn once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.figures import write_figures

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="package")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the figures; tests leave it as it is."""
    made = tmp_path_factory.mktemp("figures") / "new"
    write_figures(made)
    return made
