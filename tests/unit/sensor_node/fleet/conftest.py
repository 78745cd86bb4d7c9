from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.unit.sensor_node.fleet.shards import Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def build(**sections: Any) -> Bench:
        made.append(Bench(tmp_path / f"fleet-{len(made)}", **sections))
        return made[-1]

    yield build
    for each in made:
        each.close()
