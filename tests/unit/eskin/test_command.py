"""The command says what is wrong in one clear line, with status 2."""

from __future__ import annotations

import os
import re
import socket
import sqlite3
import subprocess
import sys
from importlib.metadata import version
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.access import digest, token_id
from eskin_cloud.store import Store
from eskin_sensor_node.profile import Profile

from eskin.demo.supervised_process import SupervisedProcess, SupervisedProcessError
from eskin.identity import Identity
from tests.support.commands import run
from tests.support.processes import ESKIN, free_port, wait_until

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities

COMMANDS = ["demo", "audit", "node", "gateway", "cloud", "pki", "pki enrol", "cloud login"]


@pytest.mark.parametrize("command", ["", *COMMANDS, "subjects"])
def test_help_is_everywhere(command: str) -> None:
    done = run(*command.split(), "--help")
    assert done.returncode == 0
    assert "Usage: eskin" in done.stdout


@pytest.mark.parametrize("command", ["", "pki", "subjects"])
def test_command_alone_shows_help_and_nothing_else(command: str) -> None:
    alone, asked = run(*command.split()), run(*command.split(), "--help")
    assert (alone.returncode, alone.stdout, alone.stderr) == (0, asked.stdout, "")


def test_version_is_the_installed_one() -> None:
    done = subprocess.run(
        [ESKIN, "--version"], capture_output=True, text=True, timeout=90, check=False
    )
    assert (done.returncode, done.stdout) == (0, f"eskin {version('eskin')}\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["node"], "config"),
        (["frobnicate"], "frobnicate"),
        (["noed"], "Did you mean 'node'? See"),
        (["cloud"], "--config FILE.toml"),
        (["cloud", "login"], "--config FILE.toml"),
        (["cloud", "--config", "/none.toml", "login"], "/none.toml cannot be read"),
        (["demo", "--data", __file__], "is a file. See"),
        (["audit", f"--data={__file__}"], "is a file. See"),
        (["pki", "list", "--dir", "nope"], "nope: there is no CA; `eskin pki init"),
        (["pki", "revoke", "--dir", "nope", "--name", "n"], "nope: there is no CA"),
        (
            ["pki", "issue", "--dir", "nope", "--kind", "node", "--name", "n", "--out", "o"],
            "nope: there is no CA",
        ),
        (["demo", "--nodes", "0"], "0"),
        (["demo", "--port", "many"], "many"),
        (["demo", "--speed", "nan", "--bogus"], "bogus"),
        (["audit", "--data", "/nonexistent"], "/nonexistent"),
        (["gateway", "--config", "/nonexistent.toml"], "/nonexistent.toml cannot be read"),
        (
            ["pki", "issue", "--dir", "x", "--kind", "robot", "--name", "n", "--out", "o"],
            "'--kind': 'robot' is not one of 'node'",
        ),
        (
            ["pki", "issue", "--dir", "x", "--name", "n", "--out", "o"],
            "'--kind'. Choose from: node, ",
        ),
        (["warm", "nosuch"], "'parts': 'nosuch' is not one of 'notebook'"),
    ],
)
def test_bad_usage_is_one_line_and_status_2(arguments: list[str], words: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "Traceback" not in done.stderr


_FINGERTIP = Profile.read("fingertip").text
NODE = """
[node]
name = "fingertip"
profile = "fingertip"
[identity]
directory = "x"
site = "x"
[flash]
path = "x"
[truth]
path = "x"
"""
GATEWAY = """
[identity]
directory = "x"
site = "x"
[spool]
path = "x"
"""
CLOUD = """
[store]
path = "x"
[gateways]
identity = "x"
"""
TAXEL = re.sub(r"capacitance_min_F = \S+", "capacitance_min_F = 1.0", _FINGERTIP)


@pytest.mark.parametrize(
    ("process", "text", "words"),
    [
        ("node", NODE + "[broker]\nprot = 1\n", ["broker.prot", "no such setting"]),
        ("node", NODE + '[broker]\nport = "x"\n', ["broker.port", "'x'"]),
        ("node", NODE + TAXEL, ["taxel.0", "capacitance"]),
        ("node", NODE.replace('"fingertip"', '"a.b"', 1), ["node.name", "'a.b'"]),
        ("gateway", GATEWAY + "[http]\nport = 70000\n", ["http.port", "70000"]),
        ("gateway", GATEWAY + '[http]\nhost = "0.0.0.0"\n', ["http.host", "loopback"]),
        ("gateway", GATEWAY + "[bogus]\nx = 1\n", ["bogus", "no such setting"]),
        ("gateway", GATEWAY, ["x/key.pem", "eskin pki issue"]),
        ("gateway", NODE, ["spool", "is missing", "gateway settings"]),
        ("subjects list", NODE, ["spool", "is missing", "gateway settings"]),
        ("cloud", CLOUD + "[people]\nport = 1.5\n", ["people.port", "1.5"]),
        ("cloud", CLOUD + '[people]\nhost = "0.0.0.0"\n', ["people", "loopback"]),
        ("cloud", "[store]\n", ["store.path", "is missing"]),
        ("cloud", CLOUD.replace("[store]", "[sotre]"), ["store"]),
    ],
)
def test_bad_configuration_is_one_line_and_status_2(
    tmp_path: Path, process: str, text: str, words: list[str]
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(text)
    done = run(*process.split(), "--config", str(config), cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert all(word in done.stderr for word in words), done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("before", [True, False])
def test_cloud_login_takes_its_config_before_or_after(tmp_path: Path, *, before: bool) -> None:
    config = tmp_path / "cloud.toml"
    config.write_text(CLOUD + "[people]\nport = 8123\n")
    with Store(tmp_path / "x"):
        pass
    option = ["--config", str(config)]
    words = ["cloud", *option, "login"] if before else ["cloud", "login", *option]
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("http://127.0.0.1:8123/login?code=")


def test_tokens_are_listed_and_revoked_and_all_of_it_is_logged(tmp_path: Path) -> None:
    config = tmp_path / "cloud.toml"
    config.write_text(CLOUD)
    option = ["--config", str(config)]
    made = run("cloud", "token", "--name", "lab", *option, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    listed = run("cloud", "tokens", *option, cwd=tmp_path).stdout
    assert "lab" in listed
    assert "good" in listed
    assert made.stdout.strip() not in listed
    number = token_id(digest(made.stdout.strip()))
    assert run("cloud", "revoke", "--id", number, *option, cwd=tmp_path).returncode == 0
    assert "revoked" in run("cloud", "tokens", *option, cwd=tmp_path).stdout
    again = run("cloud", "revoke", "--id", number, *option, cwd=tmp_path)
    assert (again.returncode, len(again.stderr.splitlines())) == (2, 1)
    stated = run("cloud", "audit-log", *option, cwd=tmp_path)
    assert stated.returncode == 0
    assert [line.partition(" command line - ")[2] for line in stated.stdout.splitlines()] == [
        f"token created {number} lab: read",
        f"token revoked {number} lab",
    ]
    with sqlite3.connect(tmp_path / "x") as store:
        store.execute("DROP TRIGGER audit_log_no_update")
        store.execute("UPDATE audit_log SET actor = 'another'")
    store.close()
    broken = run("cloud", "audit-log", *option, cwd=tmp_path)
    assert (broken.returncode, broken.stderr) == (
        1,
        "BROKEN: deed 0 is missing or was changed afterwards\n",
    )


def test_ca_that_exists_stays_as_it_is(tmp_path: Path) -> None:
    ca = tmp_path / "ca"
    assert run("pki", "init", "--dir", str(ca)).returncode == 0
    before = {path: path.read_bytes() for path in ca.iterdir()}
    done = run("pki", "init", "--dir", str(ca))
    assert done.returncode == 2
    assert done.stderr == (
        f"eskin: {ca}: there is a CA already, which stays as it is; "
        "choose another folder for a new one\n"
    )
    assert {path: path.read_bytes() for path in ca.iterdir()} == before


def test_ca_that_lost_its_root_is_not_made_anew(tmp_path: Path) -> None:
    ca = tmp_path / "ca"
    issue = ["--kind", "node", "--name", "n", "--site", "site.a", "--out", str(tmp_path / "n")]
    assert run("pki", "init", "--dir", str(ca)).returncode == 0
    assert run("pki", "issue", "--dir", str(ca), *issue).returncode == 0
    (ca / "root.pem").unlink()
    key = (ca / "node.key").read_bytes()
    done = run("pki", "init", "--dir", str(ca))
    assert done.returncode == 2
    assert "ledger.jsonl but no root.pem" in done.stderr
    assert (ca / "node.key").read_bytes() == key


def test_fleet_gets_an_identity_and_a_key_of_its_own_for_each_node(tmp_path: Path) -> None:
    ca, out = tmp_path / "ca", tmp_path / "out"
    issue = ["--kind", "node", "--name", "skin", "--site", "site.a"]
    issue += ["--out", str(out), "--count", "3"]
    assert run("pki", "init", "--dir", str(ca)).returncode == 0
    done = run("pki", "issue", "--dir", str(ca), *issue)
    assert done.stdout.startswith(f"skin-0001 to skin-0003 in {out}, valid until ")
    names = ["skin-0001", "skin-0002", "skin-0003"]
    identities = [Identity.load(out / name) for name in names]
    assert [identity.name for identity in identities] == names
    assert len({identity.key.private_numbers().private_value for identity in identities}) == 3
    again = run("pki", "issue", "--dir", str(ca), *issue)
    assert again.returncode == 2
    assert "skin-0001: there is an identity already" in again.stderr


def test_ca_service_without_a_folder_for_a_token_says_so(tmp_path: Path) -> None:
    config = tmp_path / "ca.toml"
    config.write_text(
        '[ca]\ndirectory = "ca"\n'
        '[[identity]]\nkind = "node"\nname = "palm"\nsite = "site.main"\ndirectory = "nowhere"\n'
    )
    done = run("pki", "serve", "--config", str(config), cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "eskin: identity.directory: nowhere, for the token of palm, is no folder; make it\n"
    )


def test_list_of_identities_is_whole_when_piped(identities: Identities) -> None:
    done = run("pki", "list", "--dir", str(identities.ca))
    assert done.returncode == 0
    for entry in identities.authority.issued():
        line = next(line for line in done.stdout.splitlines() if entry.serial in line)
        assert line.split() == [
            *(entry.name, entry.kind, entry.site or "-", entry.expires),
            *(entry.revoked or "-", entry.serial),
        ]


def test_demo_says_which_port_is_taken(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        done = run("demo", "--port", port, "--data", str(tmp_path / "data"))
    assert done.returncode == 2
    assert all(word in done.stderr.splitlines()[0] for word in ["--port", port, "another"])


def test_gateway_says_which_port_is_taken(tmp_path: Path, identities: Identities) -> None:
    config = tmp_path / "gateway.toml"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        config.write_text(
            f"[identity]\ndirectory = '{identities.gateway.directory}'\n"
            f"site = '{identities.site.directory}'\n"
            f"[spool]\npath = '{tmp_path / 'spool.sqlite'}'\n[http]\nport = {port}\n"
        )
        done = run("gateway", "--config", str(config))
    assert done.returncode == 2
    assert done.stderr.endswith(
        f"eskin: http.port: 127.0.0.1:{port} cannot be listened on: Address already in use; "
        "choose another port, or 0 for any free one\n"
    )


@pytest.mark.nightly
def test_demo_says_how_to_audit_and_where_the_data_stay(tmp_path: Path) -> None:
    data, port = tmp_path / "data", str(free_port())
    options = ["--data", str(data), "--nodes", "1", "--port", port, "--duration", "0.1"]
    done = subprocess.run(
        [ESKIN, "demo", *options],
        capture_output=True, text=True, timeout=90, check=False,
        env={**os.environ, "PATH": "/usr/bin:/bin"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert f"Check the data: {ESKIN} audit --data {data}\n" in done.stderr
    assert done.stderr.splitlines()[-1] == f"Stopped; the data stay in {data}"


def test_child_that_dies_shows_only_this_start(tmp_path: Path) -> None:
    log = tmp_path / "child.log"
    log.write_text("a line of an earlier start\n")
    child = SupervisedProcess(
        "child", [sys.executable, "-c", "print('new'); exit(3)"], log_file=log
    )
    child.start()
    wait_until(lambda: child.pid is None, "it died")
    with pytest.raises(SupervisedProcessError, match="status 3") as caught:
        child.require_alive()
    assert str(caught.value).splitlines()[1:] == ["new"]
    assert "earlier" in log.read_text()
