from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.identity.certificates import pem
from tests.brokers import Mosquitto
from tests.sensor_node.stores import Store

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.identities import Identities


@pytest.fixture
def broker(tmp_path: Path, identities: Identities) -> Iterator[Mosquitto]:
    with Mosquitto(tmp_path / "broker", identities) as running:
        yield running


@pytest.fixture
def site_file(tmp_path: Path, identities: Identities) -> Path:
    path = tmp_path / "site.pem"
    path.write_bytes(pem([identities.site.certificate]))
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where `store` keeps its messages."""
    return tmp_path / "flash.sqlite"


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    """An outbox on a flash."""
    opened = Store(path)
    yield opened
    opened.flash.close()
