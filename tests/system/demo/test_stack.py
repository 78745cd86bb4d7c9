"""From a touch on the skin to an answer of the API, and to any MQTT client."""

from __future__ import annotations

import json
import stat
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest

from eskin.identity import Identity
from eskin.wire.timestamp import parse_timestamp
from tests.support.files import ask
from tests.support.processes import ESKIN, Running, free_port, wait_until
from tests.support.skin_watcher import Seen
from tests.unit.services.party import Party

if TYPE_CHECKING:
    from tests.support.demos import RunningDemo

NODES = {"fingertip", "palm", "forearm", "hand"}


def test_nodes_report_and_their_channels_fill(demo: RunningDemo) -> None:
    nodes = {item["id"]: item for item in demo.get("/nodes")["items"]}
    assert set(nodes) == NODES
    assert {item["health"] for item in nodes.values()} == {"online"}
    for node in NODES:
        channels = demo.get(f"/nodes/{node}/channels")["items"]
        assert len(channels) == nodes[node]["channels"] >= 3
        assert all(channel["last"] is not None for channel in channels)


def test_series_of_a_capacitance_lies_in_its_physical_range(demo: RunningDemo) -> None:
    channels = {item["id"]: item for item in demo.get("/nodes/fingertip/channels")["items"]}
    first = parse_timestamp(channels["t01.capacitance"]["first"])
    series = demo.get(
        "/series/fingertip/t01.capacitance", start=first, end=first + 10**9, points=20_000
    )
    assert series["resolution"] == "sample"
    pairs = [(lo, hi) for lo, hi in zip(series["lo"], series["hi"], strict=True) if lo is not None]
    assert len(pairs) > 100
    assert all(lo <= hi for lo, hi in pairs)
    assert min(hi for _, hi in pairs) >= 9.5e-12
    assert max(lo for lo, _ in pairs) <= 105e-12


def test_audit_passes_while_the_demo_runs(demo: RunningDemo) -> None:
    done = subprocess.run(
        [ESKIN, "audit", "--data", str(demo.data)],
        capture_output=True, text=True, timeout=250, check=False, env={"COLUMNS": "200"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout


def test_audit_passes_after_one_taxel_is_sampled_more_slowly(demo: RunningDemo) -> None:
    newest = "SELECT samples FROM frames WHERE node = 'fingertip' ORDER BY t DESC LIMIT 1"
    before = ask(demo.store, newest)
    path = "/api/v1/nodes/fingertip/commands"
    with demo.client() as client:
        order = {"name": "set", "arguments": {"rate": 250, "taxel": "t01"}}
        client.post(path, json=order).raise_for_status()
        wait_until(lambda: ask(demo.store, newest) < before, "frames have fewer samples")
        test_audit_passes_while_the_demo_runs(demo)
        client.post(path, json={"name": "reset"}).raise_for_status()
        wait_until(lambda: ask(demo.store, newest) >= before, "frames have all samples again")


FRAMES = 12
OF_HAND = "SELECT t, t_end - t, samples FROM frames WHERE node = 'hand'"


def next_frames_of_hand(demo: RunningDemo, count: int) -> list[tuple[int, ...]]:
    """Wait for frames: first sample, span and number of samples of each."""
    newest = max(t for t, *_ in ask(demo.store, OF_HAND))
    found: set[tuple[int, ...]] = set()

    def are_there() -> bool:
        found.update(row for row in ask(demo.store, OF_HAND) if row[0] > newest)
        return len(found) >= count

    wait_until(are_there, f"{count} more frames")
    return sorted(found)[:count]


@pytest.mark.nightly
def test_watching_changes_nothing_that_a_node_sends(demo: RunningDemo, tmp_path: Path) -> None:
    unwatched = next_frames_of_hand(demo, FRAMES)
    seen, port = tmp_path / "seen", httpx.URL(demo.access["url"]).port
    words = [sys.executable, "-m", "tests.support.skin_watcher", str(port), "hand", str(seen)]
    token = {"ESKIN_TOKEN": demo.access["token"]}
    with Running(words, log=tmp_path / "log", env=token) as watcher:
        watcher.wait_for(lambda: seen.exists() and len(Seen.read(seen).frames) > 5, "frames come")
        watched = next_frames_of_hand(demo, FRAMES)
        assert Seen.read(seen).wrong == []
    for frames in (unwatched, watched):
        assert {frame[1:] for frame in frames} == {frame[1:] for frame in unwatched}
        steps = {second[0] - first[0] for first, second in pairwise(frames)}
        assert steps == {100_000_000}


def test_access_file_is_for_its_owner_and_opens_the_api(demo: RunningDemo) -> None:
    path = demo.data / "access.json"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    url = demo.access["url"]
    assert httpx.get(f"{url}/api/v1/nodes", timeout=60).status_code == 401
    token = {"Authorization": f"Bearer {demo.access['token']}"}
    assert httpx.get(f"{url}/api/v1/nodes", headers=token, timeout=60).status_code == 200


def mosquitto(demo: RunningDemo, program: str, *arguments: str) -> list[str]:
    mqtt = demo.access["mqtt"]
    return [
        program, "-h", mqtt["host"], "-p", str(mqtt["port"]), "--cafile", mqtt["ca"],
        "--cert", mqtt["cert"], "--key", mqtt["key"], *arguments,
    ]  # fmt: skip


def test_other_mqtt_client_reads_live_topics(demo: RunningDemo) -> None:
    read = mosquitto(demo, "mosquitto_sub", "-t", "eskin/v1/live/palm/t01.area", "-C", "3")
    done = subprocess.run(read, capture_output=True, text=True, timeout=200, check=True)
    for line in done.stdout.splitlines():
        hull = json.loads(line)
        assert 0 <= hull["lo"] <= hull["hi"]
        assert hull["unit"] == "m2"
        assert hull["t0"] < hull["t1"]


def test_what_the_read_only_client_publishes_reaches_no_client(demo: RunningDemo) -> None:
    topic = "eskin/v1/live/palm/t01.area"
    mqtt = demo.access["mqtt"]
    own = Identity.load(Path(mqtt["cert"]).parent)
    with Party(own, mqtt["port"], root=Path(mqtt["ca"]), client_id="reader") as reader:
        reader.subscribe(topic)
        for _ in range(3):
            write = mosquitto(demo, "mosquitto_pub", "-t", topic, "-q", "1", "-m", "forged")
            subprocess.run(write, capture_output=True, timeout=120, check=False)
        enough = len(reader.heard) + 3
        wait_until(lambda: len(reader.heard) >= enough, "what is genuine comes, also behind it")
    assert {heard for heard, _ in reader.heard} == {topic}
    assert b"forged" not in {payload for _, payload in reader.heard}


def test_login_url_opens_the_dashboard_once(demo: RunningDemo) -> None:
    with httpx.Client(follow_redirects=True, timeout=60) as browser:
        page = browser.get(demo.login_url)
        assert page.status_code == 200
        assert page.url.path == "/"
        assert browser.get(f"{demo.access['url']}/api/v1/nodes").status_code == 200
    with httpx.Client(timeout=60) as second:
        again = second.get(demo.login_url)
        assert again.status_code in {400, 401, 403, 410}
        assert second.get(f"{demo.access['url']}/api/v1/nodes").status_code == 401


def test_events_hold_certain_peaks(demo: RunningDemo) -> None:
    wait_until(
        lambda: bool(demo.get("/events", kind="peak", verdict="certain")["items"]),
        "a certain peak",
    )
    peak = demo.get("/events", kind="peak", verdict="certain")["items"][0]
    assert peak["count"] == {"lo": 1, "hi": 1}
    assert peak["time"]["lo"] < peak["time"]["hi"]
    assert peak["height"]["lo"] <= peak["height"]["hi"]


def test_command_reaches_the_node_and_its_state_comes_back(demo: RunningDemo) -> None:
    with demo.client() as client:
        asked = client.post(
            "/api/v1/nodes/palm/commands", json={"name": "set", "arguments": {"smoothing": 0.5}}
        )
        assert asked.status_code in {201, 202}, asked.text
        path = f"/nodes/palm/commands/{asked.json()['id']}"
        wait_until(lambda: demo.get(path)["state"] == "done", "the command is done")
        state = demo.get("/nodes/palm/state")
        assert state["settled"] is True
        assert state["reported"]["t01"]["smoothing"] == 0.5
        client.post("/api/v1/nodes/palm/commands", json={"name": "reset"})


def test_monitor_is_set_by_a_command_and_its_verdicts_become_events(demo: RunningDemo) -> None:
    squeeze = {"formula": "t01.capacitance > 50 pF", "on": "possible", "output": "stop"}
    with demo.client() as client:

        def ask(arguments: dict[str, str]) -> str:
            path = "/api/v1/nodes/fingertip/commands"
            asked = client.post(path, json={"name": "monitor", "arguments": arguments})
            assert asked.status_code == 202, asked.text
            command = f"/nodes/fingertip/commands/{asked.json()['id']}"
            wait_until(lambda: demo.get(command)["state"] in {"done", "refused"}, "the answer")
            return str(demo.get(command)["state"])

        def found() -> set[str]:
            items = demo.get("/events", kind="verdict", node="fingertip")["items"]
            own = [each for each in items if json.loads(each["detail"])["monitor"] == "squeeze"]
            return {each["verdict"] for each in own}

        assert ask({"monitor": "squeeze", **squeeze}) == "done"
        state = demo.get("/nodes/fingertip/state")
        assert state["settled"] is True
        assert state["reported"]["monitor:squeeze"] == squeeze
        wait_until(lambda: found() == {"impossible", "possible", "certain"}, "all verdicts")
        assert ask({"monitor": "ahead", "formula": "always[0,1s] t01.current > 0"}) == "refused"
        assert ask({"monitor": "squeeze"}) == "done"
        state = demo.get("/nodes/fingertip/state")
        assert state["settled"] is False  # the refused one is still desired
        assert "monitor:squeeze" not in state["reported"]
        client.post("/api/v1/nodes/fingertip/commands", json={"name": "reset"})


def test_second_demo_on_the_same_folder_is_refused(demo: RunningDemo) -> None:
    done = subprocess.run(
        [ESKIN, "demo", "--data", str(demo.data), "--port", str(free_port())],
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "runs on" in done.stderr


def test_port_in_use_is_named(demo: RunningDemo, tmp_path_factory: pytest.TempPathFactory) -> None:
    done = subprocess.run(
        [ESKIN, "demo", "--data", str(tmp_path_factory.mktemp("x")), "--port", str(demo.port)],
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert f"--port: {demo.port} cannot be used" in done.stderr
