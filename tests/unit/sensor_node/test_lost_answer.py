"""A node whose last result does not open any more: it must do no command twice."""

from __future__ import annotations

import sqlite3
import time
from contextlib import closing
from typing import TYPE_CHECKING

import pytest

from eskin.errors import FlashError
from eskin.identity import IdentityKind
from tests.unit.sensor_node.flashes import change
from tests.unit.sensor_node.test_commands import Rig

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities


@pytest.fixture
def rig(tmp_path: Path, identities: Identities) -> Iterator[Rig]:
    server = identities.make(IdentityKind.SERVER, "server.cloud")
    made = Rig(tmp_path, identities, server, time.time_ns())
    yield made
    made.flash.close()


def test_node_with_unreadable_result_runs_and_takes_no_command(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    asked = rig.signed(7, {"rate": 5.0})
    rig.commander.take(asked)
    with closing(sqlite3.connect(rig.path)) as db:
        (before,) = db.execute("SELECT body FROM answer").fetchone()
    change(rig.path, "UPDATE answer SET body = zeroblob(80)")
    rig.restart()
    assert "last result of fingertip does not open" in caplog.text
    with pytest.raises(FlashError, match="takes no command; bring back a copy"):
        rig.commander.take(asked)
    assert rig.controls.calls == []
    change(rig.path, "UPDATE answer SET body = ?", before)
    rig.commander.take(asked)
    rig.commander.take(rig.signed(8, {"rate": 6.0}))
    assert rig.controls.calls == [("set", {"rate": 6.0})]
