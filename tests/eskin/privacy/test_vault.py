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

from eskin import lockfile
from eskin.errors import NoKeyError, PrivacyError
from eskin.privacy import FileMaster, Vault
from eskin.privacy import files as room
from eskin.privacy.turn import turn
from tests.processes import wait_until

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.privacy import Subject

LATE = "ab" * 16


def everything(folder: Path) -> bytes:
    return b"".join(
        str(path).encode() + path.read_bytes() for path in folder.rglob("*") if path.is_file()
    )


def test_subject_is_found_again_by_another_process(vault: Vault, tmp_path: Path) -> None:
    made = vault.create("Ada")
    other = Vault(vault.directory, FileMaster(tmp_path / "master.key"))
    assert other.find(made.pseudonym) == made
    assert other.named("Ada") == [made]
    assert other.named("Bo") == []


def test_files_are_their_owners_alone_and_tell_no_name_and_no_key(vault: Vault) -> None:
    made = vault.create("Ada Lovelace")
    held = everything(vault.directory)
    assert b"Lovelace" not in held
    assert made.key not in held
    assert made.salt not in held
    for path in vault.directory.rglob("*"):
        assert path.stat().st_mode & 0o077 == 0, path


def test_pseudonym_is_keyed(vault: Vault) -> None:
    made = vault.create("Ada")
    secret = vault._master.unwrap((vault.directory / "secret").read_bytes(), b"secret")
    digest = hmac.new(secret, made.salt + b"Ada", hashlib.sha256).hexdigest()
    assert made.pseudonym == digest[:32]
    assert len({vault.create("Ada").pseudonym for _ in range(5)} | {made.pseudonym}) == 6


def test_key_that_others_may_read_is_refused(vault: Vault, tmp_path: Path) -> None:
    made = vault.create("Ada")
    (tmp_path / "master.key").chmod(0o640)
    with pytest.raises(PrivacyError, match="chmod 600"):
        FileMaster(tmp_path / "master.key")
    (vault.directory / "subjects" / made.pseudonym).chmod(0o604)
    other = Vault(vault.directory, vault._master)
    with pytest.raises(PrivacyError, match="chmod 600"):
        other.find(made.pseudonym)


def test_keys_of_another_master_are_refused(vault: Vault, tmp_path: Path) -> None:
    made = vault.create("Ada")
    stranger = Vault(vault.directory, FileMaster(tmp_path / "other.key"))
    with pytest.raises(PrivacyError, match="was not wrapped by"):
        stranger.find(made.pseudonym)


def test_wrapped_key_of_one_subject_passes_for_no_other(vault: Vault) -> None:
    one, two = vault.create("Ada"), vault.create("Bo")
    folder = vault.directory / "subjects"
    (folder / two.pseudonym).write_bytes((folder / one.pseudonym).read_bytes())
    with pytest.raises(PrivacyError, match="was not wrapped by"):
        vault.find(two.pseudonym)


def test_erasure_overwrites_the_key_and_leaves_a_tombstone(vault: Vault, tmp_path: Path) -> None:
    made = vault.create("Ada")
    path = vault.directory / "subjects" / made.pseudonym
    wrapped = path.read_bytes()
    twin = tmp_path / "same blocks on the disk"
    twin.hardlink_to(path)
    # With a second name the bytes would stay, so they are overwritten only without one.
    twin.unlink()
    with path.open("rb") as held:
        grave = vault.erase(made.pseudonym)
        assert held.read() not in {wrapped, b""}
    assert (grave.erased, grave.confirmed) == (7, None)
    assert wrapped not in everything(vault.directory)
    assert vault.subjects() == []
    vault.confirm(grave)
    assert [(g.pseudonym, g.confirmed) for g in vault.graves()] == [(made.pseudonym, 7)]
    with pytest.raises(NoKeyError):
        vault.find(made.pseudonym)


def test_erasure_elsewhere_counts_at_once(vault: Vault) -> None:
    made = vault.create("Ada")
    reader = Vault(vault.directory, vault._master)
    assert reader.find(made.pseudonym) == made
    vault.erase(made.pseudonym)
    with pytest.raises(NoKeyError):
        reader.find(made.pseudonym)


def test_power_cut_between_tombstone_and_key_ends_in_no_key(
    vault: Vault, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = vault.create("Ada")

    def cut(path: Path) -> None:
        raise SystemExit(str(path))

    monkeypatch.setattr("eskin.privacy.vault.destroy", cut)
    with pytest.raises(SystemExit):
        vault.erase(made.pseudonym)
    monkeypatch.setattr("eskin.privacy.vault.destroy", room.destroy)
    assert Vault(vault.directory, vault._master).subjects() == []


def test_what_is_erased_never_comes_back(vault: Vault) -> None:
    key, late = bytes(32), "a" * 32
    assert vault.keep(late, key)
    assert not vault.keep(late, key)
    vault.erase(late)
    with pytest.raises(NoKeyError):
        vault.keep(late, key)
    assert vault.bury("b" * 32)
    assert not vault.bury("b" * 32)
    with pytest.raises(NoKeyError):
        vault.keep("b" * 32, key)


@pytest.mark.parametrize("name", ["../secret", "", "A" * 32, "a" * 31])
def test_pseudonym_is_no_path(vault: Vault, name: str) -> None:
    with pytest.raises(NoKeyError):
        vault.find(name)


def test_key_that_comes_while_its_subject_is_erased_is_not_left(
    vault: Vault, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = Vault(vault.directory, vault._master)
    burial = Thread(target=other.bury, args=[LATE])
    write, waits = vault._write, Event()

    def sleep(seconds: float) -> None:
        waits.set()
        time.sleep(seconds)

    def late(subject: Subject) -> None:
        burial.start()
        wait_until(lambda: waits.is_set() or not burial.is_alive(), "it waits, or is over")
        write(subject)

    monkeypatch.setattr(lockfile, "time", SimpleNamespace(monotonic=time.monotonic, sleep=sleep))
    monkeypatch.setattr(vault, "_write", late)
    assert vault.keep(LATE, bytes(32))
    burial.join()
    assert not (vault.directory / "subjects" / LATE).exists()
    with pytest.raises(NoKeyError, match="destroyed"):
        vault.find(LATE)


def test_tombstone_counts_before_a_key_that_lies_beside_it(vault: Vault) -> None:
    made = vault.create("Ada")
    path = vault.directory / "subjects" / made.pseudonym
    wrapped = path.read_bytes()
    vault.erase(made.pseudonym)
    room.write_private(path, wrapped)
    for reader in (vault, Vault(vault.directory, vault._master)):
        with pytest.raises(NoKeyError, match="destroyed"):
            reader.find(made.pseudonym)
        assert reader.subjects() == []
    room.write_private(path, wrapped)
    assert not vault.bury(made.pseudonym)
    assert not path.exists()


def test_processes_take_turns_at_a_key_store(vault: Vault, monkeypatch: pytest.MonkeyPatch) -> None:
    program = (
        "import sys; from pathlib import Path; from eskin.privacy.turn import turn\n"
        "with turn(Path(sys.argv[1])): print('mine', flush=True); sys.stdin.read()"
    )
    words = [sys.executable, "-c", program, str(vault.directory)]
    monkeypatch.setattr("eskin.privacy.turn._PATIENCE_S", 0.05)
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"mine\n"
        with pytest.raises(PrivacyError, match="keeps it locked"):
            vault.keep(LATE, bytes(32))
        with pytest.raises(PrivacyError, match="keeps it locked"):
            vault.bury(LATE)
        other.kill()  # however it ends, so does its turn
    assert vault.keep(LATE, bytes(32))


def cut_off(path: Path, target: Path) -> None:
    raise SystemExit(f"{path}, {target}")


def keep_cut_off(vault: Vault, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep a key in a power cut; gives the file that is left."""
    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.replace", cut_off)
        with pytest.raises(SystemExit):
            vault.keep(LATE, bytes(32))
    (left,) = (vault.directory / "subjects").iterdir()
    return left


def test_power_cut_while_a_key_is_kept_leaves_no_copy_behind_an_erasure(
    vault: Vault, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = keep_cut_off(vault, monkeypatch)
    assert vault._master.unwrap(left.read_bytes(), LATE.encode())
    vault.keep(LATE, bytes(32))
    vault.bury(LATE)
    assert list((vault.directory / "subjects").iterdir()) == []


def test_what_a_power_cut_left_is_destroyed_at_the_next_opening(
    vault: Vault, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = keep_cut_off(vault, monkeypatch)
    wrapped = left.read_bytes()
    with left.open("rb") as held:
        Vault(vault.directory, vault._master)
        assert held.read() not in {wrapped, b""}
    assert not left.exists()


def test_file_that_another_one_writes_just_now_is_left_alone(
    vault: Vault, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin.privacy.turn._PATIENCE_S", 0.05)
    with turn(vault.directory):
        partial = vault.directory / "subjects" / f".{LATE}.0123abcd"
        partial.touch(mode=0o600)
        with pytest.raises(PrivacyError, match="keeps it locked"):
            vault.finish()
        assert partial.exists()
    vault.finish()
    assert not partial.exists()


@pytest.mark.parametrize("step", ["pathlib.Path.replace", "os.fsync"])
def test_key_that_cannot_be_put_in_place_leaves_no_copy(
    vault: Vault, monkeypatch: pytest.MonkeyPatch, step: str
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
            vault.keep(LATE, bytes(32))
    assert list((vault.directory / "subjects").iterdir()) == []


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
