"""The files of docker-compose name what is there, and grant each service as little as any other.

`tests/system/compose` and `tests/system/cluster/compose` start them on an engine. The statements by
which the store of the second is distributed: `tests/unit/cloud/test_distribution.py`.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qs, urlsplit

import pytest
import yaml
from eskin_ca.settings import CaSettings
from eskin_cloud.settings import CloudSettings
from eskin_gateway.settings import GatewaySettings
from eskin_sensor_node.settings import NodeSettings

from eskin.runtime.settings import Settings, table

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT: Final = Path(__file__).parents[3]
MAIN: Final = "docker-compose.yml"
CLUSTER: Final = "docker-compose.cluster.yml"
STACKS: Final = {"main": (MAIN,), "cluster": (MAIN, CLUSTER)}
SETTINGS: Final[dict[str, tuple[type[Settings], str]]] = {
    "eskin-cloud": (CloudSettings, "cloud/cloud.toml"),
    "eskin-gateway": (GatewaySettings, "gateway/gateway.toml"),
    "eskin-sensor-node": (NodeSettings, "sensor_node/sensor_node.toml"),
}
"""By image: what its process reads."""
CA_FILES: Final = {"main": "ca_service/ca.toml", "cluster": "ca_service/cluster.toml"}
ONCE: Final = {"join", "distribute"}
"""Services that end."""

Document = dict[str, Any]


def read(name: str) -> Document:
    document = yaml.safe_load((ROOT / name).read_text())
    assert isinstance(document, dict)
    return document


@cache
def stack(name: str) -> Document:
    """What docker-compose makes of a stack's files: a later one adds to those before it."""
    merged: Document = {}
    for file in STACKS[name]:
        merged = combine(merged, read(file))
    return merged


def combine(old: Any, new: Any) -> Any:
    if isinstance(old, dict) and isinstance(new, dict):
        both = {key: combine(old[key], new[key]) for key in old.keys() & new.keys()}
        return {**old, **new, **both}
    if isinstance(old, list) and isinstance(new, list) and old != new:
        return old + new
    return new


def services(name: str) -> dict[str, Document]:
    found: dict[str, Document] = stack(name)["services"]
    return found


ALL: Final = [(name, service) for name in STACKS for service in services(name)]
each_service = pytest.mark.parametrize(("name", "service"), ALL)
each_stack = pytest.mark.parametrize("name", STACKS)


def mounts(service: Document) -> dict[str, str]:
    """Volumes by the folder where they are."""
    return {each.split(":")[1]: each.split(":")[0] for each in service.get("volumes", [])}


def dockerfile(service: Document) -> str:
    build: dict[str, str] = service["build"]
    return (ROOT / build["context"] / build["dockerfile"]).read_text()


def of_image(name: str, image: str) -> dict[str, Document]:
    """The services of an image that go on running."""
    return {
        service: each
        for service, each in services(name).items()
        if each["image"] == image and service not in ONCE
    }


def load(name: str, service: str, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """The settings of a service, as its process reads them."""
    each = services(name)[service]
    for variable, value in each.get("environment", {}).items():
        monkeypatch.setenv(variable, value)
    settings, file = SETTINGS[each["image"]]
    return settings.load(ROOT / file)


@each_service
def test_service_names_what_is_there(name: str, service: str) -> None:
    each = services(name)[service]
    assert "HEALTHCHECK" in dockerfile(each) or each.get("profiles")
    assert set(each.get("networks", [])) <= set(stack(name)["networks"])
    assert set(mounts(each).values()) <= set(stack(name)["volumes"])
    for other, wanted in each.get("depends_on", {}).items():
        needed = services(name)[other]
        if wanted["condition"] == "service_completed_successfully":
            assert needed["restart"] == "no"
        else:
            assert wanted["condition"] == "service_healthy"
            assert "healthcheck" not in needed


@each_stack
def test_each_volume_and_network_is_used(name: str) -> None:
    used = services(name).values()
    assert {volume for each in used for volume in mounts(each).values()} == set(
        stack(name)["volumes"]
    )
    assert {network for each in used for network in each.get("networks", [])} == set(
        stack(name)["networks"]
    )


@each_stack
def test_no_services_wait_for_each_other(name: str) -> None:
    waiting = {service: set(each.get("depends_on", {})) for service, each in services(name).items()}
    while ready := {service for service, others in waiting.items() if not others & set(waiting)}:
        waiting = {service: each for service, each in waiting.items() if service not in ready}
    assert waiting == {}


@each_service
def test_service_is_confined_as_all_are(name: str, service: str) -> None:
    main, each = read(MAIN), services(name)[service]
    confined = {key: value for key, value in main["x-service"].items() if key != "restart"}
    assert {key: each.get(key) for key in confined} == confined
    ends = service in ONCE or "profiles" in each
    assert each["restart"] == ("no" if ends else "unless-stopped")
    limits = {key: each.get(key) for key in main["x-large"]}
    assert limits in (main["x-small"], main["x-large"])
    assert not {"privileged", "cap_add", "devices", "pid", "ipc", "user"} & set(each)


def test_files_say_the_same_of_all_services() -> None:
    main, cluster = read(MAIN), read(CLUSTER)
    names = {"x-service", "x-small", "x-large", "x-arguments"}
    assert {key: cluster[key] for key in names} == {key: main[key] for key in names}
    assert re.search(r"CITUS_SOURCE: \$\{CITUS_SOURCE:\?[^}]+\}", (ROOT / CLUSTER).read_text())


@each_service
def test_service_has_a_network_only_where_it_must(name: str, service: str) -> None:
    each = services(name)[service]
    if each["image"] in {"eskin-database", "eskin-citus"} or service == "distribute":
        assert each["network_mode"] == "none"
        assert not each.keys() & {"networks", "ports"}
        return
    assert "network_mode" not in each
    assert each["networks"]
    assert ("dashboard" in each["networks"]) == (each["image"] == "eskin-cloud")
    assert ("ports" in each) == (each["image"] == "eskin-cloud")


@each_stack
def test_only_loopback_is_published(name: str) -> None:
    ports = [port for each in services(name).values() for port in each.get("ports", [])]
    published = [re.fullmatch(r"127\.0\.0\.1:\$\{ESKIN_PORT\d?:-(\d+)\}:8080", x) for x in ports]
    assert len({found and found[0] for found in published}) == len(ports)
    assert len({found[1] for found in published if found}) == len(ports)
    networks = stack(name)["networks"]
    assert [each for each, how in networks.items() if how != {"internal": True}] == ["dashboard"]


@pytest.mark.parametrize(("name", "clouds", "gateways"), [("main", 1, 1), ("cluster", 3, 2)])
def test_stack_has_its_parts(name: str, clouds: int, gateways: int) -> None:
    assert len(of_image(name, "eskin-cloud")) == clouds
    assert len(of_image(name, "eskin-gateway")) == gateways
    assert len(of_image(name, "eskin-sensor-node")) == 3
    assert len(of_image(name, "eskin-citus")) == (3 if name == "cluster" else 0)


@each_service
def test_environment_is_known_and_allowed(
    name: str, service: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    each = services(name)[service]
    variables = set(each.get("environment", {}))
    if each["image"] not in SETTINGS:
        assert variables <= ({"PGPORT"} if each["image"] == "eskin-citus" else set())
        return
    settings, file = SETTINGS[each["image"]]
    entrypoint = (ROOT / file).with_name("entrypoint.sh").read_text()
    known = {each.variable for each in table(settings)} | set(re.findall(r"ESKIN_\w+", entrypoint))
    assert variables <= known
    load(name, service, monkeypatch)


@each_stack
def test_each_party_may_enrol_under_its_name(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = CaSettings.load(ROOT / CA_FILES[name])
    ca = services(name)["ca"]
    folders = mounts(ca)
    file = ca.get("command", ["/etc/eskin/ca.toml"])[-1]
    assert file == f"/etc/eskin/{Path(CA_FILES[name]).name}"
    assert {str(each.directory) for each in expected.identity} == {
        folder for folder in folders if folder.startswith("/enrol/")
    }
    made = set(re.findall(r"/enrol/\w+", dockerfile(ca)))
    assert {str(each.directory) for each in expected.identity} <= made
    of_volume = {
        volume: {each.name: each for each in expected.identity if str(each.directory) == folder}
        for folder, volume in folders.items()
    }
    for service, each in services(name).items():
        if service == "ca" or "/enrol" not in mounts(each):
            continue
        offered = of_volume[mounts(each)["/enrol"]]
        variables = each.get("environment", {})
        if each["image"] == "eskin-cloud":
            own = offered[variables.get("ESKIN_CLOUD_NAME", "server.cloud")]
            assert service in own.hosts
        elif each["image"] == "eskin-gateway":
            with monkeypatch.context() as patch:
                settings = load(name, service, patch)
            assert isinstance(settings, GatewaySettings)
            assert settings.identity.directory.name in offered


def test_ca_of_the_cluster_expects_all_that_the_other_one_does() -> None:
    main, cluster = (CaSettings.load(ROOT / file) for file in CA_FILES.values())
    assert (cluster.ca, cluster.log) == (main.ca, main.log)
    assert [each for each in cluster.identity if each in main.identity] == list(main.identity)


def gateways(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Document, GatewaySettings]]:
    for service, each in of_image("cluster", "eskin-gateway").items():
        with monkeypatch.context() as patch:
            settings = load("cluster", service, patch)
        assert isinstance(settings, GatewaySettings)
        yield each, settings


def test_each_gateway_knows_each_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    clouds = of_image("cluster", "eskin-cloud")
    first = []
    for each, settings in gateways(monkeypatch):
        urls = [settings.cloud.url, *settings.cloud.fallbacks]
        hosts = [urlsplit(url).hostname or "" for url in urls]
        assert sorted(hosts) == sorted(clouds)
        assert all(set(clouds[host]["networks"]) & set(each["networks"]) for host in hosts)
        assert {urlsplit(url)._replace(netloc="").geturl() for url in urls} == {
            "https:///api/v1/ingest"
        }
        first.append(hosts[0])
    assert len(set(first)) == len(first), "they begin with clouds of their own"


def test_gateways_share_a_group_and_the_keys_of_their_site(monkeypatch: pytest.MonkeyPatch) -> None:
    found = list(gateways(monkeypatch))
    assert len({settings.broker.group for _, settings in found} - {""}) == 1
    for path in ("identity.site", "keys.directory", "keys.master"):
        section, field = path.split(".")
        places = {getattr(getattr(settings, section), field) for _, settings in found}
        assert len(places) == 1, path
        (place,) = places
        volumes = {mounts(each).get(str(place.parent)) for each, _ in found}
        assert len(volumes) == 1, path
        assert None not in volumes, path
    own = [mounts(each)[str(settings.spool.path.parent)] for each, settings in found]
    assert len(set(own)) == len(own), "each has a spool of its own"


def test_servers_of_the_store_meet_by_sockets_in_one_volume(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    servers = of_image("cluster", "eskin-citus")
    ports = {service: each["environment"]["PGPORT"] for service, each in servers.items()}
    assert ports["database"] == "5432"
    assert len(set(ports.values())) == 3
    join = services("cluster")["join"]
    assert join["entrypoint"] == ["join.sh", "5432", *sorted(set(ports.values()) - {"5432"})]
    assert set(join["depends_on"]) == set(servers)
    settings = load("cluster", "cloud", monkeypatch)
    assert isinstance(settings, CloudSettings)
    (folder,) = parse_qs(urlsplit(settings.store.url or "").query)["host"]
    reaching = [*servers.values(), *of_image("cluster", "eskin-cloud").values(), join]
    reaching.append(services("cluster")["distribute"])
    assert {mounts(each)[folder] for each in reaching} == {"database_socket"}
    configuration = (ROOT / "services/citus/citus.conf").read_text()
    assert f"citus.local_hostname = '{folder}'" in configuration
    base = (ROOT / "services/database/postgresql.conf").read_text()
    assert f"unix_socket_directories = '{folder}'" in base
    assert "listen_addresses = ''" in base
    data = [mounts(each)["/var/lib/eskin"] for each in servers.values()]
    assert len(set(data)) == len(data)


def test_clouds_wait_until_the_store_is_distributed() -> None:
    for each in of_image("cluster", "eskin-cloud").values():
        assert each["depends_on"]["distribute"] == {"condition": "service_completed_successfully"}
    steps = services("cluster")
    assert steps["distribute"]["depends_on"] == {
        "join": {"condition": "service_completed_successfully"}
    }


def lines(name: str) -> list[list[str]]:
    text = (ROOT / "services/citus" / name).read_text()
    return [line.split() for line in text.splitlines() if line and not line.startswith("#")]


def test_clouds_are_no_administrators_of_a_server() -> None:
    assert lines("pg_hba.conf") == [["local", "eskin", "eskin,postgres", "peer", "map=cluster"]]
    assert [words for words in lines("pg_ident.conf") if words[2] == "postgres"] == [
        ["cluster", "citus", "postgres"]
    ]
    image = (ROOT / "services/citus/Dockerfile").read_text()
    users = dict(re.findall(r"useradd --uid (\d+) .* (\w+) \\", image))
    assert users == {"10001": "eskin", "10002": "citus"}
    cloud = (ROOT / "cloud/Dockerfile").read_text()
    assert dict(re.findall(r"useradd --uid (\d+) .* (\w+) \\", cloud)) == {"10001": "eskin"}
