"""Fixtures that several rooms share, and which tests run on which worker."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings
from limits.aio.storage import memory
from xdist.scheduler import LoadScopeScheduling

from eskin.identity import IdentityKind
from tests.support.identities import Identities
from tests.support.postgresql import Cluster

if TYPE_CHECKING:
    from collections.abc import Iterator

# A run says something of the change alone: properties try the same inputs each time. The hunt
# tries others: ARGS="--hypothesis-profile=hunt". A pause of the machine fails no test.
PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("steady", PATIENT, derandomize=True)
settings.register_profile("hunt", PATIENT)
settings.load_profile("steady")

HERE = Path(__file__).parent
SHARED = ("unit/dashboard", "system/demo")
"""Rooms that share what takes long to start."""
FIRST = (*SHARED, "system")
"""Rooms that begin first, so that no test waits for them."""
LAST = ("unit/eskin", "unit/sensor_node")
"""Rooms of many short files, which fill what is left of the time evenly."""

TOGETHER = ("tests/unit/eskin/figures/", "tests/unit/eskin/models/icm/")
"""Files that need the same large kernels, which a fresh machine then compiles once."""


class RoomScheduling(LoadScopeScheduling):  # type: ignore[misc]  # xdist has no types
    """A worker takes a whole file, or a whole room of those above."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        rooms = (*(f"tests/{room}/" for room in SHARED), *TOGETHER)
        return next((room for room in rooms if file.startswith(room)), file)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> RoomScheduling:
    """Share tests out by rooms; xdist's own groups do nothing under pytest 9.2."""
    return RoomScheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the rooms that take longest first, and in each what needs no shared demo before it.

    A demo keeps half a processor busy from its first test to its room's last.
    """
    order = dict.fromkeys(LAST, len(FIRST) + 1) | {room: n for n, room in enumerate(FIRST)}

    def rank(item: pytest.Item) -> tuple[int, bool]:
        file = item.path.relative_to(HERE).as_posix()
        room = next((room for room in order if file.startswith(f"{room}/")), "")
        return order.get(room, len(FIRST)), "demo" in getattr(item, "fixturenames", ())

    items.sort(key=rank)


@pytest.fixture(scope="session")
def identities(tmp_path_factory: pytest.TempPathFactory) -> Identities:
    """A CA, a node, a site and a gateway."""
    return Identities(tmp_path_factory.mktemp("identities"))


@pytest.fixture(scope="session")
def cluster(identities: Identities) -> Iterator[Cluster]:
    """A PostgreSQL server, started when the first test asks for it."""
    with Cluster(identities.make(IdentityKind.SERVER, "server.database")) as running:
        yield running


@pytest.fixture
def standing_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the windows by which requests are counted, time stands: no slow machine outlasts one."""
    monkeypatch.setattr(memory, "time", SimpleNamespace(time=lambda: 1e9))
