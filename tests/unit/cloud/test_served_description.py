"""The running cloud answers as its description says, whatever the caller: over a real socket."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

import httpx
import pytest
import schemathesis
from eskin_cloud.access import Scope, create_token
from eskin_cloud.store import Store
from hypothesis import HealthCheck, Phase, given, settings

from tests.unit.cloud.clouds import batch
from tests.unit.cloud.described import check_answer
from tests.unit.cloud.messages import gap, peak, status, stretch
from tests.unit.cloud.service import PATIENCE_S, Service

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.identities import Identities

EXAMPLES: Final = 3
"""Of each operation, for each who asks."""
VISITORS: Final = {"unknown": (), **{str(scope): (scope,) for scope in Scope}, "all": tuple(Scope)}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, identities: Identities) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("cloud")
    with Service(folder, identities) as running:
        running.ingest(batch(status(0), stretch(1), peak(2), gap(3))).raise_for_status()
        yield running


def make_token(service: Service, scopes: tuple[Scope, ...]) -> str:
    with Store(service.place) as store:
        return create_token(store, scopes=list(scopes), name="s", lifetime=timedelta(hours=1))


@pytest.mark.parametrize(
    "visitor",
    ["all", *(pytest.param(name, marks=pytest.mark.nightly) for name in VISITORS if name != "all")],
)
def test_everybody_is_answered_as_described(service: Service, visitor: str) -> None:
    url = f"http://127.0.0.1:{service.port}"
    reader = {"Authorization": f"Bearer {make_token(service, (Scope.READ,))}"}
    raw = httpx.get(f"{url}/openapi.json", headers=reader, timeout=PATIENCE_S).json()
    scopes = VISITORS[visitor]
    headers = {"Authorization": f"Bearer {make_token(service, scopes)}"} if scopes else {}
    schema = schemathesis.openapi.from_dict(raw)
    schema.config.update(base_url=url, request_timeout=PATIENCE_S)
    count = 0
    for result in schema.exclude(path="/api/v1/live").get_all_operations():
        found: Any = result
        validate(found.ok(), headers)
        count += 1
    assert count == 47


def validate(operation: Any, headers: dict[str, str]) -> None:
    """Ask with drawn cases; every check is on."""

    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        database=None,
        derandomize=True,
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=list(HealthCheck),
    )
    @given(case=operation.as_strategy())
    def ask(case: Any) -> None:
        check_answer(case, headers)

    ask()
