"""What a broker's guard cannot fetch hinders nothing else, and is said once."""

from __future__ import annotations

import logging
import signal
import subprocess
from typing import TYPE_CHECKING
from unittest.mock import Mock

import pytest
from eskin_ca import mosquitto_agent as guard_module
from eskin_ca.http_client import NotReadyError
from eskin_ca.mosquitto_agent import MosquittoAgent

from eskin.identity import IdentityKind
from eskin.mosquitto.configuration import KINDS
from tests.support.identities import Identities

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


def test_kind_that_cannot_be_fetched_hinders_no_other_and_is_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    own, looks = Identities(tmp_path), 3
    fetched: list[IdentityKind] = []

    def fetch(_url: str, _identity: Path, kind: IdentityKind, out: Path) -> bool:
        if kind is KINDS[0]:
            raise NotReadyError("no list of nodes")
        fetched.append(kind)
        out.write_bytes(own.authority.revocations_file(kind).read_bytes())
        return True

    def end() -> None:
        raise NotReadyError("no")

    monkeypatch.setattr(guard_module, "fetch_anchor", lambda *_: None)
    monkeypatch.setattr(guard_module, "fetch_revocations", fetch)
    guard = MosquittoAgent(
        ["true"], identity=own.gateway.directory, url="https://ca", folder=tmp_path
    )
    with caplog.at_level(logging.WARNING):
        for _ in range(looks):
            guard.fault_log.attempt("fetching lists", guard._fetch)
            guard.fault_log.attempt("ending connections", end)
    assert fetched == [*KINDS[1:]] * looks
    assert len(caplog.records) == 2
    assert guard.fault_log.faults == {
        "fetching lists": "no list of nodes",
        "ending connections": "no",
    }


def test_revoked_party_is_refused_and_ended_at_the_next_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = Identities(tmp_path)
    identity = own.make(IdentityKind.SERVER, "server.broker").directory
    ended: list[list[str]] = []

    def fetch(_url: str, _identity: Path, kind: IdentityKind, out: Path) -> bool:
        out.write_bytes(own.authority.revocations_file(kind).read_bytes())
        return True

    def fetch_anchor(_url: str, _identity: Path, kind: IdentityKind, out: Path) -> None:
        if not out.exists():
            out.write_bytes(own.authority.anchor_file(kind).read_bytes())

    def fetch_revoked(_url: str, _identity: Path, kind: IdentityKind) -> set[tuple[str, str]]:
        entries = own.authority.issued()
        return {(e.name, e.serial) for e in entries if e.kind == kind and e.revoked is not None}

    def end(control: Path, names: Sequence[str]) -> None:
        assert control == tmp_path / "control.sock"
        ended.append([*names])

    monkeypatch.setattr(guard_module, "fetch_anchor", fetch_anchor)
    monkeypatch.setattr(guard_module, "fetch_revocations", fetch)
    monkeypatch.setattr(guard_module, "fetch_revoked", fetch_revoked)
    monkeypatch.setattr(guard_module, "end_connections", end)
    assert guard_module._LOOK_S <= 0.5, "so that revoked clients are disconnected in about a second"
    guard, broker = (
        MosquittoAgent(["true"], identity=identity, url="https://ca", folder=tmp_path),
        Mock(),
    )
    guard._first(0.0)
    guard._seen = guard._state()
    own.authority.revoke("fingertip")
    guard._look(broker)
    broker.send_signal.assert_called_with(signal.SIGHUP)
    assert ended == [["fingertip"]]
    guard._look(broker)
    assert ended == [["fingertip"]], "once"


@pytest.mark.parametrize("fault", [KeyError("items"), ValueError("no JSON"), OSError("no file")])
def test_unforeseen_errors_end_neither_guard_nor_broker(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    fault: Exception,
) -> None:
    def breaks() -> None:
        raise fault

    own = Identities(tmp_path)
    guard = MosquittoAgent(
        ["true"], identity=own.gateway.directory, url="https://ca", folder=tmp_path
    )
    for part in ("_fetch", "_state", "_end_revoked"):
        monkeypatch.setattr(guard, part, breaks)
    for _ in range(3):
        guard._look(Mock())
    assert [*guard.fault_log.faults] == [
        "fetching lists",
        "telling the broker",
        "ending connections",
    ]
    assert len(caplog.records) == 3


def test_broker_that_cannot_be_guarded_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = Identities(tmp_path)
    guard = MosquittoAgent(
        ["sleep", "600"], identity=own.gateway.directory, url="https://ca", folder=tmp_path
    )
    started: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def popen(argv: Sequence[str]) -> subprocess.Popen[bytes]:
        started.append(start(argv))
        return started[0]

    def breaks() -> None:
        raise OSError("no file")

    monkeypatch.setattr(guard, "_first", lambda _: None)
    monkeypatch.setattr(guard, "_state", breaks)
    monkeypatch.setattr("eskin_ca.mosquitto_agent.subprocess.Popen", popen)
    monkeypatch.setattr("eskin_ca.mosquitto_agent.signal.signal", lambda *_: None)
    with pytest.raises(OSError, match="no file"):
        guard.run()
    assert started[0].returncode == -signal.SIGTERM
