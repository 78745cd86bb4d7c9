"""What a disk leaves of compiled code is run whole, or not at all."""

from __future__ import annotations

import errno
import importlib.util
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core import caching

from eskin.kernels.jit_cache import KernelFile
from tests.unit.eskin.kernels.halves import tell, write_kernel

if TYPE_CHECKING:
    from collections.abc import Callable

KEY, CODE = ("float64", "x86_64"), (b"\x7fELF" * 50, {"name": "half"})


@pytest.fixture
def file(tmp_path: Path) -> KernelFile:
    return KernelFile(tmp_path / "half.kernel", ["half.py", 1, 2])


def test_code_is_kept_for_each_signature(file: KernelFile) -> None:
    assert file.load(KEY) is None
    file.save(KEY, CODE)
    file.save("int64", "other")
    assert (file.load(KEY), file.load("int64"), file.load("bool")) == (CODE, "other", None)
    file.flush()
    assert file.load(KEY) is None


@pytest.mark.parametrize("stamps", [["half.py", 1, 3], []])
def test_code_of_other_sources_is_stale(file: KernelFile, tmp_path: Path, stamps: Any) -> None:
    file.save(KEY, CODE)
    other = KernelFile(tmp_path / "half.kernel", stamps)
    assert other.load(KEY) is None
    other.save("int64", "new")
    assert (file.load(KEY), other.load(KEY), other.load("int64")) == (None, None, "new")


def test_code_of_another_numba_is_stale(file: KernelFile, monkeypatch: pytest.MonkeyPatch) -> None:
    file.save(KEY, CODE)
    monkeypatch.setattr("numba.__version__", "0.0")
    assert file.load(KEY) is None


def _cut(whole: bytes, at: int) -> bytes:
    return whole[:at]


def _blank(whole: bytes, at: int) -> bytes:
    """A page that never came to the disk."""
    return whole[:at] + bytes(len(whole) - at)


def _flip(whole: bytes, at: int) -> bytes:
    return whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]


@given(st.sampled_from([_cut, _blank, _flip]), st.floats(0, 1, exclude_max=True))
def test_damaged_code_is_never_given(damage: Callable[[bytes, int], bytes], share: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "half.kernel"
        file = KernelFile(path, ["half.py", 1, 2])
        file.save(KEY, CODE)
        whole = path.read_bytes()
        damaged = damage(whole, int(share * len(whole)))
        path.write_bytes(damaged)
        assert (file.load(KEY) is None) == (damaged != whole)
        file.save(KEY, "again")
        assert file.load(KEY) == "again"


@pytest.mark.nightly
@pytest.mark.parametrize("damage", [_cut, pytest.param(_blank, marks=pytest.mark.nightly)])
def test_program_starts_on_damaged_files(
    tmp_path: Path, damage: Callable[[bytes, int], bytes]
) -> None:
    write_kernel(tmp_path)
    assert tell(tmp_path, "3.0") == ["1.5", "0"]
    assert tell(tmp_path, "3.0") == ["1.5", "1"]
    (path,) = tmp_path.rglob("*.kernel")
    path.write_bytes(damage(path.read_bytes(), 100))
    assert tell(tmp_path, "3.0") == ["1.5", "0"]
    assert tell(tmp_path, "3.0") == ["1.5", "1"]


@pytest.mark.parametrize("where", ["locks", "folder", "code"])
def test_kernel_runs_on_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, where: str
) -> None:
    def full(*_: object, **__: object) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    spec = importlib.util.spec_from_file_location("half", write_kernel(tmp_path))
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if where == "locks":
        monkeypatch.setattr(os, "open", full)
    elif where == "folder":
        monkeypatch.setattr(caching._CacheLocator, "ensure_cache_path", full)
    else:
        monkeypatch.setattr(KernelFile, "_write", full)
    assert module.half(3.0) == 1.5
    assert "compiled anew at the next start: reason=[Errno 28]" in caplog.text
