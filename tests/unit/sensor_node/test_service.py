"""The node as a process: ``eskin node``."""

from __future__ import annotations

import re
import signal
import sqlite3
import time
from contextlib import closing
from itertools import pairwise
from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.gap_reasons import OVERRUN, TEXTS
from eskin_sensor_node.machine.flash.sealing import Cipher, Row, Sealing
from eskin_sensor_node.node.factory import REBOOT
from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.privacy import open_key
from eskin.runtime.settings import KeysSection
from eskin.wire.frames import Frame, Gap, Statements
from eskin.wire.messages import Position
from tests.support.processes import ESKIN, Running, free_port, wait_until
from tests.unit.sensor_node.messages import decode, frames_of
from tests.unit.sensor_node.peer import Peer

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities

CONFIG = """\
[node]
name = "fingertip"
profile = "fingertip"
speed = {speed}
[broker]
port = {port}
drain_s = 60
[identity]
directory = "{identity}"
site = "{site}"
[flash]
path = "{folder}/flash.sqlite"
[truth]
path = "{folder}/truth.sqlite"
"""
_ROWS = "SELECT boot, sequence, kind, body, earliest, latest, samples, stands_for FROM message"


class Service(Running):
    """A node's process and its files."""

    def __init__(
        self, folder: Path, identities: Identities, site: Path, *, port: int, speed: float = 1.0
    ) -> None:
        self.folder = folder
        config = folder / "node.toml"
        config.write_text(
            CONFIG.format(
                speed=speed,
                port=port,
                identity=identities.node.directory,
                site=site,
                folder=folder,
            )
        )
        super().__init__([ESKIN, "node", "--config", str(config)], log=folder / "node.log")

    def stored(self) -> dict[Position, bytes]:
        """What flash holds, as another process sees it."""
        path = (self.folder / "flash.sqlite").absolute()
        if not path.exists():
            return {}
        with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as db:
            try:
                rows = db.execute(_ROWS).fetchall()
            except sqlite3.OperationalError:
                return {}
        key = open_key(KeysSection(), self.folder / "keys", "fingertip.flash")
        sealing = Sealing(Cipher(key), "fingertip")
        kept = [sealing.open(Row(*row)) for row in rows]
        return {Position(*each.position): each.body for each in kept if each is not None}


def test_killed_node_keeps_what_it_committed_and_never_reuses_a_position(
    tmp_path: Path, identities: Identities, site_file: Path
) -> None:
    # No broker: everything must stay.
    service = Service(tmp_path, identities, site_file, port=free_port(), speed=10.0)
    everything: dict[Position, bytes] = {}
    for _ in range(3):
        with service:
            enough = len(everything) + 100
            service.wait_for(
                lambda enough=enough: len(service.stored()) > enough,  # type: ignore[misc]  # mypy infers no lambda defaults
                "a hundred messages",
            )
            seen = service.stored()
            service.kill()
        kept = service.stored()
        assert seen.items() <= kept.items()
        assert everything.items() <= kept.items()
        everything = kept
    boots = sorted({position.boot for position in everything})
    assert len(boots) == 3
    for position, body in everything.items():
        assert decode(body).position == position
    frames = [frame.position for frame in frames_of(everything.values())]
    truth = GroundTruth.read_frames(tmp_path / "truth.sqlite", frames, node="fingertip")
    assert len(truth) == len(frames)
    for earlier, later in pairwise(boots):
        end = max(t.end for t in truth.values() if t.position.boot == earlier)
        assert min(t.time for t in truth.values() if t.position.boot == later) >= end + REBOOT


def test_node_runs_through_the_broker_and_ends_on_sigterm(
    tmp_path: Path, identities: Identities, site_file: Path, broker: Mosquitto
) -> None:
    with (
        Peer(identities, broker.gateway_port) as peer,
        Service(tmp_path, identities, site_file, port=broker.node_port, speed=5.0) as service,
    ):
        service.wait_for(lambda: len(peer.messages) > 200, "200 messages")
        assert service.stop() == 0
        wait_until(lambda: service.stored() == {}, "everything was acknowledged")
        sequences = {position.sequence for position in peer.messages}
        assert sequences == set(range(len(sequences)))
        output = service.output()
        assert len(re.findall(r"running: node=fingertip boot=\d+ speed=5", output)) == 1
        assert "stopped: node=fingertip waiting=0" in output


def test_stopped_process_leaves_a_gap_that_counts_what_is_missing(
    tmp_path: Path, identities: Identities, site_file: Path, broker: Mosquitto
) -> None:
    with (
        Peer(identities, broker.gateway_port) as peer,
        Service(tmp_path, identities, site_file, port=broker.node_port) as service,
    ):
        service.wait_for(lambda: len(peer.messages) > 10, "it runs")
        service.signal(signal.SIGSTOP)
        stopped = time.monotonic()
        wait_until(lambda: time.monotonic() > stopped + 2.5, "a stop that is long enough")
        service.signal(signal.SIGCONT)

        def gaps() -> list[tuple[Position, Gap]]:
            stated = (m for m in peer.messages.values() if isinstance(m, Statements))
            return [(each.position, gap) for each in stated for gap in each.gaps]

        def frames() -> list[Frame]:
            return [m for m in peer.messages.values() if isinstance(m, Frame)]

        def long() -> list[Position]:
            """A busy machine may have stopped it for a shorter while."""
            return [position for position, gap in gaps() if gap.samples > 6 * 2000]

        service.wait_for(lambda: bool(long()), "a gap")
        begin = long()[0]
        service.wait_for(lambda: any(f.position > begin for f in frames()), "frames come again")
    assert {gap.reason for _, gap in gaps()} == {TEXTS[OVERRUN]}
    last = max(frames(), key=lambda frame: frame.position)
    rows = sum(frame.grids[0].rows for frame in frames())
    missing = last.ticks // 1_000_000 + last.grids[0].rows - rows
    assert missing > 2000
    reported = [gap.samples for position, gap in gaps() if position < last.position]
    assert sum(reported) == 6 * missing


def test_missing_identity_is_one_clear_line_and_status_2(
    tmp_path: Path, identities: Identities, site_file: Path
) -> None:
    service = Service(tmp_path, identities, tmp_path / "nowhere.pem", port=1)
    assert site_file.exists()
    service.start()
    assert service.ended() == 2
    assert "nowhere.pem" in service.output()
