"""The drill: each part is copied while it is used, used on, and restored from its copy."""

from __future__ import annotations

import shutil
import sqlite3
import stat
from contextlib import closing, contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.write.missing_messages import find_missing, find_missing_tails
from eskin_gateway.forward.forwarder import Forwarder
from eskin_gateway.metrics import Metrics
from eskin_gateway.settings import CloudSection
from eskin_gateway.spool.batch import Batch, NodeCertificate, SpoolMessage
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.spool import Spool
from eskin_gateway.upstream.certificates_client import CertificatesClient
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.confirmations_client import ConfirmationsClient
from eskin_gateway.upstream.descriptions_client import DescriptionsClient
from eskin_gateway.upstream.ingest_client import IngestClient

from eskin.cli.backup import backup, copy
from eskin.errors import IdentityError, SettingsError
from eskin.identity import CertificateAuthority, IdentityKind, client_context, der
from eskin.identity.identity import ROOT_FILE
from eskin.wire.messages import Position
from tests.support.identities import SITE
from tests.support.postgresql import program
from tests.support.processes import ESKIN, Running, wait_until
from tests.unit.cloud.clouds import Clock, put
from tests.unit.cloud.messages import NODE, START, status, stretch
from tests.unit.cloud.service import PATIENCE_S, Service
from tests.unit.gateway.in_memory import quick
from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.stores import Store as FlashStore

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.support.postgresql import Cluster


def restore(source: Path, target: Path) -> None:
    """Put a copy in the place of a file or folder, as an operator does."""
    if source.is_dir():
        shutil.rmtree(target)
        shutil.copytree(source, target)
        return
    for left in target.parent.glob(f"{target.name}*"):
        left.unlink()
    shutil.copyfile(source, target)


def test_copy_of_a_database_in_use_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "used" / "store.sqlite"
    path.parent.mkdir()
    stop, written = Event(), Event()

    def write() -> None:
        with closing(sqlite3.connect(path, isolation_level=None)) as db:
            db.execute("PRAGMA journal_mode = WAL")
            db.execute("CREATE TABLE t (a INTEGER, b INTEGER)")
            number = 0
            while not stop.is_set():
                number += 1
                db.execute("BEGIN IMMEDIATE")
                db.execute("INSERT INTO t VALUES (?, 0)", (number,))
                db.execute("UPDATE t SET b = ? WHERE a = ?", (number, number))
                db.execute("COMMIT")
                written.set()

    writer = Thread(target=write)
    writer.start()
    try:
        assert written.wait(60)
        for number in range(5):
            copy(path.parent, tmp_path / f"copy{number}")
    finally:
        stop.set()
        writer.join()
    for number in range(5):
        folder = tmp_path / f"copy{number}"
        assert [each.name for each in folder.iterdir()] == ["store.sqlite"]
        assert stat.S_IMODE((folder / "store.sqlite").stat().st_mode) == 0o600
        with closing(sqlite3.connect(folder / "store.sqlite")) as db:
            (count, most, wrong) = db.execute(
                "SELECT count(*), max(a), sum(a <> b) FROM t"
            ).fetchone()
        assert (count, wrong) == (most, 0)
        assert count > 0


def test_copy_is_made_into_a_new_folder_alone(tmp_path: Path) -> None:
    with pytest.raises(SettingsError):
        backup([str(tmp_path)], tmp_path)


@pytest.mark.nightly
def test_store_from_yesterday_names_what_it_lacks(tmp_path: Path) -> None:
    path, out = tmp_path / "store.sqlite", tmp_path / "out"
    with Store(path, clock=Clock(START)) as store:
        put(store, *(stretch(number) for number in range(4)))
        backup([str(path)], out)
        put(store, *(stretch(number) for number in range(4, 9)))
    restore(out / path.name, path)
    with Store(path, clock=Clock(START)) as store, store.read() as connection:
        assert find_missing_tails(connection, [(NODE, 1, 8)]) == [(NODE, 1, 4, 8)]


@pytest.mark.nightly
def test_store_from_before_a_node_names_all_of_it_though_the_node_says_nothing(
    tmp_path: Path, identities: Identities
) -> None:
    path, out = tmp_path / "data" / "store.sqlite", tmp_path / "out"
    with Store(path):
        backup([str(path)], out)
    own = identities.make(IdentityKind.NODE, NODE)
    record = NodeState(thumbprint=own.thumbprint)
    sender = NodeCertificate(own.thumbprint, 2**40, *(der(part) for part in own.chain))
    entries = [SpoolMessage(NODE, 1, status(number).encode(), 1, number) for number in range(4)]
    spool = Spool(tmp_path / "spool.sqlite", capacity=10**7, max_dead_letters=3)
    spool.commit(Batch(entries, nodes={NODE: record}, certificates=[sender]))
    with Service(tmp_path, identities, place=path) as cloud, forwarding(spool, cloud) as forwarder:
        wait_until(lambda: spool.confirmed() == [(NODE, 1, 3)], "the cloud confirmed all")
        assert forwarder.missing == 0
    restore(out / path.name, path)
    with (
        Service(tmp_path / "restored", identities, place=path) as cloud,
        forwarding(spool, cloud) as forwarder,
    ):
        wait_until(lambda: forwarder.missing == 4, "the gateway names what is missing")
    with Store(path) as store, store.read() as connection:
        assert find_missing(connection) == {(NODE, 1): [(0, 3)]}
    spool.close()


@pytest.mark.nightly
def test_node_that_the_restored_cloud_refuses_is_named_by_the_gateway(
    tmp_path: Path, identities: Identities
) -> None:
    spool = Spool(tmp_path / "spool.sqlite", capacity=10**7, max_dead_letters=3)
    entry = SpoolMessage("unseen", 1, b"x", 5, 6)
    spool.commit(Batch([entry]))
    (stored,) = spool.take(1, 99)
    spool.settle([stored], confirmed=[stored])
    with Service(tmp_path, identities) as cloud, forwarding(spool, cloud) as forwarder:
        wait_until(lambda: forwarder.missing == 7, "the gateway names what is missing")
    spool.close()


@contextmanager
def forwarding(spool: Spool, cloud: Service) -> Iterator[Forwarder]:
    """A gateway's forwarder, between its spool and the cloud."""
    client = CloudClient(
        [f"https://localhost:{cloud.ingest_port}/api/v1/ingest"],
        headers=lambda: {"Content-Type": "application/cbor"},
        context=client_context(cloud.server.directory / ROOT_FILE, cloud.gateway),
        timeout_s=PATIENCE_S,
    )
    certificates = CertificatesClient(client, spool)
    forwarder = Forwarder(
        CloudSection(),
        spool=spool,
        ingest_client=IngestClient(client),
        certificates_client=certificates,
        descriptions_client=DescriptionsClient(client, spool),
        backoff=quick(),
        metrics=Metrics(),
        confirmations_client=ConfirmationsClient(client, certificates),
    )
    forwarder.start()
    try:
        yield forwarder
    finally:
        forwarder.stop()
        client.close()


@pytest.mark.nightly
def test_postgresql_from_yesterday_names_what_it_lacks(tmp_path: Path, cluster: Cluster) -> None:
    place, other = cluster.fresh(), cluster.fresh(empty=True)
    with Store(place, clock=Clock(START)) as store:
        put(store, *(stretch(number) for number in range(4)))
        url = place.set(drivername="postgresql").render_as_string(hide_password=False)
        backup([url], tmp_path / "out")
        put(store, *(stretch(number) for number in range(4, 9)))
    (dump,) = (tmp_path / "out").iterdir()
    target = other.set(drivername="postgresql").render_as_string(hide_password=False)
    argv = [program("pg_restore"), "--no-owner", f"--dbname={target}", str(dump)]
    with Running(argv, log=tmp_path / "restore.log") as restoring:
        assert restoring.ended() == 0
    with Store(other, clock=Clock(START)) as store, store.read() as connection:
        assert find_missing_tails(connection, [(NODE, 1, 8)]) == [(NODE, 1, 4, 8)]


def test_spool_from_yesterday_sends_again_and_takes_what_comes(tmp_path: Path) -> None:
    path, out = tmp_path / "spool.sqlite", tmp_path / "out"

    def opened() -> Spool:
        return Spool(path, capacity=10**7, max_dead_letters=3)

    spool, record = opened(), NodeState()
    record.add(Position(1, 0))
    spool.commit(Batch([SpoolMessage("n", 1, b"old", 1, 0)], nodes={"n": record}))
    backup([str(path)], out)
    record.add(Position(1, 1))
    spool.commit(Batch([SpoolMessage("n", 1, b"new", 1, 1)], nodes={"n": record}))
    spool.close()
    restore(out / path.name, path)
    spool = opened()
    known = spool.node("n")
    assert known is not None
    assert known.is_duplicate(Position(1, 0))  # is sent again, which is safe
    assert not known.is_duplicate(Position(1, 1))  # lost, unless the node still holds it
    assert [each.body for each in spool.take(9, 99)] == [b"old"]
    spool.close()


def test_flash_from_yesterday_starts_above_all_numbers(tmp_path: Path) -> None:
    path, out = tmp_path / "flash.sqlite", tmp_path / "out"
    store = FlashStore(path)
    store.fill(3)
    backup([str(path)], out)
    boot = store.outbox.boot
    store.fill(3)
    store.flash.close()
    restore(out / path.name, path)
    flash = open_flash(path, epoch=boot + 100)
    assert flash.boot == boot + 100
    assert flash.ended() == [(boot, 2)]  # less than the cloud has: it says so
    flash.close()


def test_ca_from_yesterday_forgets_no_revocation_once_it_has_the_latest_list(
    identities: Identities, tmp_path: Path
) -> None:
    folder, out = identities.ca, tmp_path / "out"
    palm = identities.make(IdentityKind.NODE, "palm")
    backup([str(folder)], out)
    before = {each.serial_number for each in palm.chain}
    identities.authority.revoke("palm")
    latest = (folder / "node.crl.pem").read_bytes()  # as every party that verifies nodes has it
    restore(out / folder.name, folder)
    (folder / "node.crl.pem").write_bytes(latest)
    again = CertificateAuthority.open(folder)
    with pytest.raises(IdentityError):
        again.issue(IdentityKind.NODE, "palm", palm.key.public_key(), site=SITE)
    again.write_revocations(IdentityKind.NODE)
    fresh = identities.make(IdentityKind.NODE, "thumb")
    assert before.isdisjoint({fresh.chain[0].serial_number})


def test_command_copies_what_it_is_given(tmp_path: Path) -> None:
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys" / "master.key").write_bytes(b"k" * 32)
    argv = [ESKIN, "backup", str(tmp_path / "keys"), "--out", str(tmp_path / "out")]
    with Running(argv, log=tmp_path / "backup.log") as running:
        assert running.ended() == 0
    assert (tmp_path / "out" / "keys" / "master.key").read_bytes() == b"k" * 32
