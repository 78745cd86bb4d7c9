"""Subjects and erasures reach the cloud after outages and restarts."""

from __future__ import annotations

import json
import math
import shutil
from typing import TYPE_CHECKING, Any

import pytest
from eskin_gateway.ingest.biometric import BiometricEncryptor
from eskin_gateway.ops import subject_sync as room
from eskin_gateway.ops.subject_sync import SubjectSync
from eskin_gateway.spool.subject_assignments import SubjectAssignments
from eskin_gateway.upstream.subjects_client import SubjectsClient

from eskin.errors import CloudError, NoKeyError, PrivacyError
from eskin.privacy import FileMasterKey, KeyStore
from eskin.runtime.digest import with_check
from tests.support.processes import wait_until
from tests.unit.gateway.certificates import KnownNodes
from tests.unit.gateway.in_memory import quick

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

NODE = "hand"


class Site(SubjectsClient):
    """A gateway's key store, and a cloud that may be away."""

    def __init__(self, folder: Path) -> None:
        self.keystore = KeyStore(folder / "site", FileMasterKey(folder / "site.key"))
        self.cloud = KeyStore(folder / "cloud", FileMasterKey(folder / "cloud.key"))
        self.assignments = SubjectAssignments(self.keystore)
        self.away = False
        self.stated: list[tuple[str, str, bytes | None]] = []
        self.sizes: list[int] = []

    def send(
        self, worn: Sequence[tuple[str, str, bytes | None]], erased: Sequence[str]
    ) -> dict[str, str]:
        if self.away:
            raise CloudError("away")
        self.stated += worn
        self.sizes.append(max(len(worn), len(erased)))
        for pseudonym in erased:
            self.cloud.shred(pseudonym)
        results = dict.fromkeys(erased, "erased")
        for pseudonym, _, key in worn:
            if self.cloud.tombstone(pseudonym) is not None:
                results[pseudonym] = "erased"
            elif key is not None:
                self.cloud.keep(pseudonym, key)
        return results

    def start(
        self, *, share: bool = True, assignments: SubjectAssignments | None = None
    ) -> SubjectSync:
        """A gateway starts, perhaps again."""
        assignments = assignments or SubjectAssignments(self.keystore)
        return SubjectSync(
            self.keystore,
            assignments,
            encryptor=BiometricEncryptor(assignments),
            subjects_client=self,
            certificates_client=KnownNodes(),
            share=share,
            backoff=quick(),
        )


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path)


@pytest.mark.parametrize("restarted", [False, True])
def test_keys_of_all_wearers_reach_the_cloud_after_an_outage(
    site: Site, *, restarted: bool
) -> None:
    site.away = True
    subject_sync = site.start()
    before = site.assignments.subject(NODE, 0)
    ada, after = site.keystore.create("Ada"), site.keystore.create()
    site.assignments.assign(NODE, ada, since=10)
    with pytest.raises(CloudError):
        subject_sync.sync()
    site.assignments.assign(NODE, after, since=20)
    site.away = False
    if restarted:
        subject_sync = site.start()
    subject_sync.sync()
    for subject in (before, ada, after):
        assert site.cloud.find(subject.pseudonym).key == subject.key
    assert [(stated, node) for stated, node, _ in site.stated] == [
        (subject.pseudonym, NODE) for subject in (before, ada, after)
    ]
    subject_sync.sync()
    assert len(site.stated) == 3


def erase_late(site: Site) -> str:
    """Erase a subject whose data come afterwards; gives the pseudonym."""
    ada = site.keystore.create("Ada")
    site.assignments.assign(NODE, ada, since=10)
    site.assignments.release(ada.pseudonym, since=20)
    site.keystore.erase(ada.pseudonym)
    return ada.pseudonym


def test_erasure_is_confirmed_before_late_data_of_its_subject_are_sent(site: Site) -> None:
    subject_sync = site.start(assignments=site.assignments)
    subject_sync.confirm_erasures()
    ada = erase_late(site)
    subject_sync.confirm_erasures()
    assert site.sizes == [], "no data of an erased subject came, so there is no hurry"
    site.assignments.subject(NODE, 15)
    site.away = True
    for _ in range(2):
        with pytest.raises(CloudError):
            subject_sync.confirm_erasures()
    site.away = False
    subject_sync.confirm_erasures()
    assert site.cloud.tombstone(ada) is not None
    assert subject_sync.pending == 0
    site.assignments.subject(NODE, 15)
    subject_sync.confirm_erasures()
    assert site.sizes == [1]


def test_gateway_confirms_erasures_after_a_start_as_its_spool_may_hold_late_data(
    site: Site,
) -> None:
    ada = erase_late(site)
    site.start().confirm_erasures()
    assert site.cloud.tombstone(ada) is not None


def test_damaged_record_of_an_erasure_holds_up_no_data(site: Site) -> None:
    ada = erase_late(site)
    (record,) = [path for path in site.keystore.directory.rglob(ada) if path.is_file()]
    record.write_bytes(b"nonsense")
    subject_sync = site.start()
    subject_sync.confirm_erasures()
    assert site.sizes == []
    with pytest.raises(PrivacyError):
        subject_sync.sync()


def test_only_the_erasure_of_an_erased_subject_is_sent(site: Site) -> None:
    ada = site.keystore.create("Ada")
    site.assignments.subject(NODE, 0)
    site.assignments.assign(NODE, ada, since=10)
    site.assignments.release(ada.pseudonym, since=20)
    site.keystore.erase(ada.pseudonym)
    site.start().sync()
    assert ada.pseudonym not in {pseudonym for pseudonym, _, _ in site.stated}
    with pytest.raises(NoKeyError, match="destroyed"):
        site.cloud.find(ada.pseudonym)
    assert site.start().pending == 0


@pytest.mark.parametrize("share", [False, True])
def test_restored_key_store_does_not_restore_an_erased_subject(
    site: Site, tmp_path: Path, *, share: bool
) -> None:
    ada = site.keystore.create("Ada")
    site.assignments.assign(NODE, ada, since=10)
    site.start(share=share).sync()
    shutil.copytree(tmp_path / "site", tmp_path / "backup")
    site.keystore.erase(ada.pseudonym)
    site.start(share=share).sync()
    shutil.rmtree(tmp_path / "site")
    shutil.copytree(tmp_path / "backup", tmp_path / "site")
    site.keystore = KeyStore(tmp_path / "site", FileMasterKey(tmp_path / "site.key"))
    assert site.keystore.find(ada.pseudonym).key == ada.key
    site.start(share=share).sync()
    with pytest.raises(NoKeyError, match="destroyed"):
        site.keystore.find(ada.pseudonym)


def test_assignments_are_sent_without_keys_if_not_shared(site: Site) -> None:
    ada = site.keystore.create("Ada")
    site.assignments.assign(NODE, ada, since=10)
    site.assignments.assign(NODE, site.keystore.create(), since=20)
    site.start(share=False).sync()
    assert ada.pseudonym in {pseudonym for pseudonym, _, _ in site.stated}
    assert {key for _, _, key in site.stated} == {None}
    assert site.cloud.subjects() == []


def test_long_history_is_sent_in_parts(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_MAX_SUBJECTS", 2)
    for number in range(4):
        site.assignments.assign(NODE, site.keystore.create(), since=number + 1)
    for _ in range(3):
        site.keystore.erase(site.keystore.create().pseudonym)
    subject_sync = site.start()
    subject_sync.sync()
    assert site.sizes == [2, 1, 2, 2, 1]
    assert len(set(site.stated)) == 5
    assert subject_sync.pending == 0


@pytest.mark.parametrize("share", [False, True])
def test_unreadable_key_blocks_no_other(
    site: Site, caplog: pytest.LogCaptureFixture, *, share: bool
) -> None:
    former, erased, now = (site.keystore.create(name) for name in ("Former", "Erased", "Now"))
    for since, subject in enumerate((former, erased, now), start=1):
        site.assignments.assign(NODE, subject, since=since)
    key = site.keystore.directory / "subjects" / former.pseudonym
    key.chmod(0o640)
    site.keystore.erase(erased.pseudonym)
    site.keystore = KeyStore(
        site.keystore.directory, FileMasterKey(site.keystore.directory.parent / "site.key")
    )
    subject_sync = site.start(share=share)
    for _ in range(2):
        subject_sync.sync()
    assert subject_sync.pending == 0
    stated = {pseudonym for pseudonym, _, _ in site.stated}
    assert now.pseudonym in stated
    assert (former.pseudonym in stated) is not share, "no key is read where none is shared"
    assert caplog.text.count("chmod 600") == int(share)
    key.chmod(0o600)
    subject_sync.sync()
    assert former.pseudonym in {pseudonym for pseudonym, _, _ in site.stated}


def test_erasures_are_sent_despite_a_damaged_assignment(site: Site) -> None:
    ada = site.keystore.create("Ada")
    site.assignments.assign(NODE, ada, since=1)
    site.keystore.erase(ada.pseudonym)
    (site.keystore.directory / "nodes" / NODE).write_text("worn out")
    subject_sync = site.start()
    with pytest.raises(PrivacyError, match="no list"):
        subject_sync.sync()
    assert subject_sync.pending == 0


@pytest.mark.parametrize("history", [[], [[5, "another"]]])
def test_history_without_a_beginning_is_an_error(site: Site, history: list[Any]) -> None:
    site.assignments.assign(NODE, site.keystore.create("Ada"), since=1)
    (site.keystore.directory / "nodes" / NODE).write_text(json.dumps(with_check({"worn": history})))
    assignments = SubjectAssignments(site.keystore)
    for ask in (assignments.all_wearers, assignments.wearers, lambda: assignments.subject(NODE, 3)):
        with pytest.raises(PrivacyError, match="from the beginning"):
            ask()


def test_unexpected_error_does_not_end_the_thread(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken: list[Exception] = [ZeroDivisionError()]
    subject_sync = site.start()
    sync = subject_sync.sync

    def once() -> None:
        if broken:
            raise broken[0]
        sync()

    monkeypatch.setattr(room, "_POLL_S", 0.01)
    monkeypatch.setattr(subject_sync, "sync", once)
    subject_sync.start()
    try:
        wait_until(lambda: subject_sync.fault is not None, "there is a fault")
        broken.clear()
        wait_until(lambda: subject_sync.fault is None, "it went on")
    finally:
        subject_sync.stop()


def test_unreadable_count_of_erasures_is_nan(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreadable() -> None:
        raise PrivacyError("graves cannot be read")

    monkeypatch.setattr(site.keystore, "tombstones", unreadable)
    assert math.isnan(site.start().pending)
