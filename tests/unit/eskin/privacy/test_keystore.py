"""Keys are their owner's alone, and once destroyed they are gone, for every reader at once."""

from __future__ import annotations

import hashlib
import hmac
import os
import subprocess
import sys
import time
from threading import Event, Thread
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from eskin.errors import NoKeyError, PrivacyError
from eskin.privacy import FileMasterKey, KeyStore
from eskin.runtime.files import atomic as room
from eskin.runtime.files import lock
from eskin.runtime.files.lock import locked_folder
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.privacy import Subject

LATE = "ab" * 16


def everything(folder: Path) -> bytes:
    return b"".join(
        str(path).encode() + path.read_bytes() for path in folder.rglob("*") if path.is_file()
    )


def test_subject_is_found_again_by_another_process(keystore: KeyStore, tmp_path: Path) -> None:
    made = keystore.create("Ada")
    other = KeyStore(keystore.directory, FileMasterKey(tmp_path / "master.key"))
    assert other.find(made.pseudonym) == made
    assert other.named("Ada") == [made]
    assert other.named("Bo") == []


def test_files_are_their_owners_alone_and_tell_no_name_and_no_key(keystore: KeyStore) -> None:
    made = keystore.create("Ada Lovelace")
    held = everything(keystore.directory)
    assert b"Lovelace" not in held
    assert made.key not in held
    assert made.salt not in held
    for path in keystore.directory.rglob("*"):
        assert path.stat().st_mode & 0o077 == 0, path


def test_pseudonym_is_keyed(keystore: KeyStore) -> None:
    made = keystore.create("Ada")
    secret = keystore._master.unwrap((keystore.directory / "secret").read_bytes(), b"secret")
    digest = hmac.new(secret, made.salt + b"Ada", hashlib.sha256).hexdigest()
    assert made.pseudonym == digest[:32]
    assert len({keystore.create("Ada").pseudonym for _ in range(5)} | {made.pseudonym}) == 6


def test_key_that_others_may_read_is_refused(keystore: KeyStore, tmp_path: Path) -> None:
    made = keystore.create("Ada")
    (tmp_path / "master.key").chmod(0o640)
    with pytest.raises(PrivacyError, match="chmod 600"):
        FileMasterKey(tmp_path / "master.key")
    (keystore.directory / "subjects" / made.pseudonym).chmod(0o604)
    other = KeyStore(keystore.directory, keystore._master)
    with pytest.raises(PrivacyError, match="chmod 600"):
        other.find(made.pseudonym)


def test_keys_of_another_master_are_refused(keystore: KeyStore, tmp_path: Path) -> None:
    made = keystore.create("Ada")
    outsider = KeyStore(keystore.directory, FileMasterKey(tmp_path / "other.key"))
    with pytest.raises(PrivacyError, match="was not wrapped by"):
        outsider.find(made.pseudonym)


def test_wrapped_key_of_one_subject_passes_for_no_other(keystore: KeyStore) -> None:
    one, two = keystore.create("Ada"), keystore.create("Bo")
    folder = keystore.directory / "subjects"
    (folder / two.pseudonym).write_bytes((folder / one.pseudonym).read_bytes())
    with pytest.raises(PrivacyError, match="was not wrapped by"):
        keystore.find(two.pseudonym)


def test_erasure_overwrites_the_key_and_leaves_a_tombstone(
    keystore: KeyStore, tmp_path: Path
) -> None:
    made = keystore.create("Ada")
    path = keystore.directory / "subjects" / made.pseudonym
    wrapped = path.read_bytes()
    twin = tmp_path / "same blocks on the disk"
    twin.hardlink_to(path)
    # With a second name the bytes would stay, so they are overwritten only without one.
    twin.unlink()
    with path.open("rb") as held:
        tombstone = keystore.erase(made.pseudonym)
        assert held.read() not in {wrapped, b""}
    assert (tombstone.erased, tombstone.confirmed) == (7, None)
    assert wrapped not in everything(keystore.directory)
    assert keystore.subjects() == []
    keystore.confirm(tombstone)
    assert [(g.pseudonym, g.confirmed) for g in keystore.tombstones()] == [(made.pseudonym, 7)]
    with pytest.raises(NoKeyError):
        keystore.find(made.pseudonym)


def test_erasure_elsewhere_counts_at_once(keystore: KeyStore) -> None:
    made = keystore.create("Ada")
    reader = KeyStore(keystore.directory, keystore._master)
    assert reader.find(made.pseudonym) == made
    keystore.erase(made.pseudonym)
    with pytest.raises(NoKeyError):
        reader.find(made.pseudonym)


def test_power_cut_between_tombstone_and_key_ends_in_no_key(
    keystore: KeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = keystore.create("Ada")

    def cut(path: Path) -> None:
        raise SystemExit(str(path))

    monkeypatch.setattr("eskin.privacy.key_erasure.destroy", cut)
    with pytest.raises(SystemExit):
        keystore.erase(made.pseudonym)
    monkeypatch.setattr("eskin.privacy.key_erasure.destroy", room.destroy)
    assert KeyStore(keystore.directory, keystore._master).subjects() == []


def test_what_is_erased_never_comes_back(keystore: KeyStore) -> None:
    key, late = bytes(32), "a" * 32
    assert keystore.keep(late, key)
    assert not keystore.keep(late, key)
    keystore.erase(late)
    with pytest.raises(NoKeyError):
        keystore.keep(late, key)
    assert keystore.shred("b" * 32)
    assert not keystore.shred("b" * 32)
    with pytest.raises(NoKeyError):
        keystore.keep("b" * 32, key)


@pytest.mark.parametrize("name", ["../secret", "", "A" * 32, "a" * 31])
def test_pseudonym_is_no_path(keystore: KeyStore, name: str) -> None:
    with pytest.raises(NoKeyError):
        keystore.find(name)


def test_key_that_comes_while_its_subject_is_erased_is_not_left(
    keystore: KeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = KeyStore(keystore.directory, keystore._master)
    burial = Thread(target=other.shred, args=[LATE])
    write, waits = keystore._write, Event()

    def sleep(seconds: float) -> None:
        waits.set()
        time.sleep(seconds)

    def late(subject: Subject) -> None:
        burial.start()
        wait_until(lambda: waits.is_set() or not burial.is_alive(), "it waits, or is over")
        write(subject)

    monkeypatch.setattr(lock, "time", SimpleNamespace(monotonic=time.monotonic, sleep=sleep))
    monkeypatch.setattr(keystore, "_write", late)
    assert keystore.keep(LATE, bytes(32))
    burial.join()
    assert not (keystore.directory / "subjects" / LATE).exists()
    with pytest.raises(NoKeyError, match="destroyed"):
        keystore.find(LATE)


def test_tombstone_counts_before_a_key_that_lies_beside_it(keystore: KeyStore) -> None:
    made = keystore.create("Ada")
    path = keystore.directory / "subjects" / made.pseudonym
    wrapped = path.read_bytes()
    keystore.erase(made.pseudonym)
    room.write_private(path, wrapped)
    for reader in (keystore, KeyStore(keystore.directory, keystore._master)):
        with pytest.raises(NoKeyError, match="destroyed"):
            reader.find(made.pseudonym)
        assert reader.subjects() == []
    room.write_private(path, wrapped)
    assert not keystore.shred(made.pseudonym)
    assert not path.exists()


def test_processes_take_turns_at_a_key_store(
    keystore: KeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = (
        "import sys; from pathlib import Path; from eskin.runtime.files.lock import locked_folder\n"
        "with locked_folder(Path(sys.argv[1])): print('mine', flush=True); sys.stdin.read()"
    )
    words = [sys.executable, "-c", program, str(keystore.directory)]
    monkeypatch.setattr("eskin.runtime.files.lock.PATIENCE_S", 0.05)
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"mine\n"
        with pytest.raises(PrivacyError, match="keeps it locked"):
            keystore.keep(LATE, bytes(32))
        with pytest.raises(PrivacyError, match="keeps it locked"):
            keystore.shred(LATE)
        other.kill()  # however it ends, so does its turn
    assert keystore.keep(LATE, bytes(32))


def cut_off(path: Path, target: Path) -> None:
    raise SystemExit(f"{path}, {target}")


def keep_cut_off(keystore: KeyStore, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep a key in a power cut; gives the file that is left."""
    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.replace", cut_off)
        with pytest.raises(SystemExit):
            keystore.keep(LATE, bytes(32))
    (left,) = (keystore.directory / "subjects").iterdir()
    return left


def test_power_cut_while_a_key_is_kept_leaves_no_copy_behind_an_erasure(
    keystore: KeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = keep_cut_off(keystore, monkeypatch)
    assert keystore._master.unwrap(left.read_bytes(), LATE.encode())
    keystore.keep(LATE, bytes(32))
    keystore.shred(LATE)
    assert list((keystore.directory / "subjects").iterdir()) == []


def test_what_a_power_cut_left_is_destroyed_at_the_next_opening(
    keystore: KeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = keep_cut_off(keystore, monkeypatch)
    wrapped = left.read_bytes()
    with left.open("rb") as held:
        KeyStore(keystore.directory, keystore._master)
        assert held.read() not in {wrapped, b""}
    assert not left.exists()


def test_file_that_another_one_writes_just_now_is_left_alone(
    keystore: KeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin.runtime.files.lock.PATIENCE_S", 0.05)
    with locked_folder(keystore.directory):
        partial = keystore.directory / "subjects" / f".{LATE}.0123abcd"
        partial.touch(mode=0o600)
        with pytest.raises(PrivacyError, match="keeps it locked"):
            keystore.finish()
        assert partial.exists()
    keystore.finish()
    assert not partial.exists()


@pytest.mark.parametrize("step", ["pathlib.Path.replace", "os.fsync"])
def test_key_that_cannot_be_put_in_place_leaves_no_copy(
    keystore: KeyStore, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    fail = iter([True])
    real = os.fsync if step == "os.fsync" else None

    def full(*given: object) -> None:
        if next(fail, False):
            raise OSError(28, "No space left on device")
        assert real is not None
        real(given[0])  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(step, full)
        with pytest.raises(PrivacyError, match="No space left"):
            keystore.keep(LATE, bytes(32))
    assert list((keystore.directory / "subjects").iterdir()) == []


def test_key_of_which_several_are_made_at_once_is_one(tmp_path: Path) -> None:
    made: list[bytes] = []

    def make() -> bytes:
        return os.urandom(32)

    threads = [
        Thread(target=lambda: made.append(room.make_once(tmp_path / "key", make))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 8
    assert set(made) == {(tmp_path / "key").read_bytes()}
