from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from eskin_sensor_node.link.publisher import Publisher
from eskin_sensor_node.settings import IdentitySection

from eskin.identity.certificates import pem
from tests.support.brokers import Mosquitto
from tests.unit.sensor_node.designs import Bench
from tests.unit.sensor_node.stores import Store

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from tests.support.identities import Identities


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


@pytest.fixture
def bench(request: pytest.FixtureRequest, tmp_path: Path, broker: Mosquitto) -> Iterator[Bench]:
    """A node whose outbox is for the broker, with its settings changed by a parameter."""
    given = {"port": broker.node_port, "resend_s": 0.5, "drain_s": 0.0, "keepalive_s": 5}
    changes = getattr(request, "param", {})
    made = Bench(
        tmp_path / "node",
        broker=given | changes.get("broker", {}),
        radio=changes.get("radio", {}),
    )
    yield made
    made.close()


@pytest.fixture
def publishing(bench: Bench, identities: Identities, site_file: Path) -> Callable[..., Any]:
    """Has that node publish within a ``with``."""

    @contextmanager
    def start() -> Iterator[Publisher]:
        publisher = Publisher(
            bench.outbox,
            record_status=bench.node.record_status,
            radio=bench.radio(),
            broker=bench.settings.broker,
            identity=IdentitySection(directory=identities.node.directory, site=site_file),
        )
        publisher.start()
        try:
            yield publisher
        finally:
            publisher.stop()

    return start
