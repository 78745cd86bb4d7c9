"""What a broker's guard cannot fetch hinders nothing else, and is said once."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from authority import guard as guard_module
from authority.asking import NotReadyError
from authority.guard import KINDS, Guard
from tests.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from eskin.identity import IdentityKind


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
        raise NotReadyError("nobody is told")

    monkeypatch.setattr(guard_module, "fetch_anchor", lambda *_: None)
    monkeypatch.setattr(guard_module, "fetch_revocations", fetch)
    guard = Guard(["true"], identity=own.gateway.directory, url="https://ca", folder=tmp_path)
    with caplog.at_level(logging.WARNING):
        for _ in range(looks):
            guard._attempt("fetching lists", guard._fetch)
            guard._attempt("ending connections", end)
    assert fetched == [*KINDS[1:]] * looks
    assert [record.getMessage() for record in caplog.records] == [
        "fetching lists failed, trying again: no list of nodes",
        "ending connections failed, trying again: nobody is told",
    ]
