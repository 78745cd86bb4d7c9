"""Operating the stack: Prometheus itself scrapes it, and the dashboard asks for what there is."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import time
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from tests.support.processes import Running, free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.demos import RunningDemo

MONITORING = Path(__file__).parents[3] / "services" / "monitoring"
DASHBOARD = json.loads((MONITORING / "grafana-dashboard.json").read_text())
ASKED = [
    target["expr"].replace("$__rate_interval", "1m")
    for panel in DASHBOARD["panels"]
    for target in panel.get("targets", [])
]
SUFFIXES = {"counter": ["_total"], "gauge": [""], "histogram": ["_bucket", "_sum", "_count"]}


def ports(demo: RunningDemo) -> dict[str, int]:
    """Where each part publishes its metrics."""
    gateway = tomllib.loads((demo.data / "gateway" / "gateway.toml").read_text())
    return {"gateway": gateway["http"]["port"], "cloud": int(demo.access["url"].rpartition(":")[2])}


def stated(demo: RunningDemo) -> set[str]:
    """Names of all figures, as Prometheus' own parser reads them."""
    names = set()
    for port in ports(demo).values():
        answer = httpx.get(f"http://127.0.0.1:{port}/metrics", timeout=60)
        for family in text_string_to_metric_families(answer.text):
            assert family.documentation, f"{family.name} has no help"
            names |= {family.name + suffix for suffix in SUFFIXES[family.type]}
    return names


@pytest.fixture(scope="module")
def prometheus(
    tmp_path_factory: pytest.TempPathFactory, demo: RunningDemo
) -> Iterator[httpx.Client]:
    """Debian's Prometheus with our configuration, looking at the demo."""
    folder = tmp_path_factory.mktemp("prometheus")
    config = (MONITORING / "prometheus.yml").read_text()
    for word, put in {
        ":9464": f":{ports(demo)['gateway']}",
        ":8080": f":{ports(demo)['cloud']}",
        "15s": "4s",  # for so long a scrape may take, too
        "alerts.yml": str(MONITORING / "alerts.yml"),
    }.items():
        assert word in config
        config = config.replace(word, put)
    (folder / "prometheus.yml").write_text(config)
    own = free_port()
    argv = [
        "prometheus",
        f"--config.file={folder}/prometheus.yml",
        f"--storage.tsdb.path={folder}/data",
        f"--web.listen-address=127.0.0.1:{own}",
        "--storage.tsdb.retention.size=64MB",
        "--log.level=warn",
    ]
    with (
        Running(argv, log=folder / "prometheus.log") as running,
        httpx.Client(base_url=f"http://127.0.0.1:{own}/api/v1", timeout=60) as client,
    ):

        def has_scraped() -> bool:
            try:
                found = ask(client, "up == 1")
            except httpx.TransportError:
                return False
            return {each["metric"]["job"] for each in found} == {"gateway", "cloud"}

        running.wait_for(has_scraped, "Prometheus has scraped both")
        yield client


def ask(prometheus: httpx.Client, query: str) -> list[Any]:
    """What Prometheus answers to a query."""
    answer = prometheus.get("/query", params={"query": query})
    if answer.status_code == 503:
        return []  # it is not ready yet
    body = answer.json()
    assert body["status"] == "success", f"{query}: {body}"
    return list(body["data"]["result"])


def test_prometheus_stores_what_the_gateway_and_the_cloud_count(prometheus: httpx.Client) -> None:
    for query in (
        "eskin_gateway_messages_accepted_total > 0",
        'eskin_cloud_items_total{result="stored"} > 0',
        "eskin_gateway_nodes_online > 0",
        "eskin_cloud_ingest_seconds_count > 0",
    ):
        # One scrape that takes too long has Prometheus forget the last one until the next.
        wait_until(lambda query=query: len(ask(prometheus, query)) == 1, query)  # type: ignore[misc]


def test_every_query_of_the_dashboard_is_understood(prometheus: httpx.Client) -> None:
    assert len(ASKED) > 20
    for query in ASKED:
        ask(prometheus, query)


def test_every_metric_of_dashboard_and_alerts_is_exported(demo: RunningDemo) -> None:
    known = stated(demo)
    alerts = (MONITORING / "alerts.yml").read_text()
    asked = {name for text in [*ASKED, alerts] for name in re.findall(r"\beskin_\w+", text)}
    assert asked
    assert asked - known == set()


def test_alerts_and_configuration_are_accepted_and_nothing_is_wrong(
    prometheus: httpx.Client,
) -> None:
    subprocess.run(
        ["promtool", "check", "config", MONITORING / "prometheus.yml"],
        check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    rules = prometheus.get("/rules").json()["data"]["groups"][0]["rules"]
    assert {rule["name"] for rule in rules} >= {"PartAway", "SpoolFills", "StoreFails"}
    wrong = [rule["name"] for rule in rules if rule["state"] == "firing"]
    assert [name for name in wrong if name in {"PartAway", "SpoolFills", "StoreFails"}] == []


def test_dashboard_has_what_grafana_needs() -> None:
    assert DASHBOARD["uid"]
    assert DASHBOARD["schemaVersion"] >= 30
    numbers = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(numbers) == len(set(numbers))
    for panel in DASHBOARD["panels"]:
        place = panel["gridPos"]
        assert place["x"] + place["w"] <= 24, panel["title"]
        if panel["type"] != "row":
            assert panel["description"], panel["title"]
            assert panel["datasource"]["uid"] == "${datasource}"


def test_requests_for_grafanas_infinity_plugin_answer_the_rows_that_are_documented(
    demo: RunningDemo,
) -> None:
    page = (MONITORING.parents[1] / "docs" / "monitoring.md").read_text()
    rows = [line.split("|")[1:-1] for line in page.splitlines() if "`/api/v1/" in line]
    assert len(rows) == 4
    now = time.time_ns() // 10**6
    for _, kind, url, items, columns in rows:
        filled = (
            url.strip("` ").replace("${__from}", str(now - 3_600_000)).replace("${__to}", str(now))
        )
        accept = {"Accept": "text/csv"} if kind.strip().startswith("CSV") else {}
        with demo.client() as client:
            answer = client.get(filled, headers=accept)
        assert answer.status_code == 200, answer.text
        found = (
            list(csv.DictReader(answer.text.splitlines()))
            if accept
            else answer.json()[items.strip("` ")]
        )
        assert found, filled
        for path in re.findall(r"`([a-z_.]+)`", columns):
            assert all(has(row, path) for row in found), path


def has(row: Any, path: str) -> bool:
    """Whether a row has a column; a gap has no height."""
    first, _, rest = path.partition(".")
    return first in row and (not rest or row[first] is None or rest in row[first])
