"""A cached kernel is compiled again when a part in it changes, and only then."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from eskin.kernels.jit import kernel, part

PART = """
from eskin.kernels.jit import part

@part
def inner(x):
    return x + {added}
"""
MIDDLE = """
from eskin.kernels.jit import part
from inner import inner

@part
def middle(x):
    return inner(x)
"""
OUTER = """
from eskin.kernels.jit import kernel, part
from middle import middle

@kernel
def outer(x):
    return below(x)

@part
def below(x):
    return middle(x)
"""
ASK = "from outer import outer; print(outer(1.0), sum(outer.stats.cache_hits.values()))"


def _ask(folder: Path) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", ASK],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": f"{folder}:{Path(__file__).parents[4]}"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.nightly
def test_change_of_a_part_deep_inside_reaches_the_kernel(tmp_path: Path) -> None:
    (tmp_path / "inner.py").write_text(PART.format(added=1.0))
    (tmp_path / "middle.py").write_text(MIDDLE)
    (tmp_path / "outer.py").write_text(OUTER)
    assert _ask(tmp_path) == ["2.0", "0"]
    assert _ask(tmp_path) == ["2.0", "1"]
    (tmp_path / "inner.py").write_text(PART.format(added=20.0))
    assert _ask(tmp_path) == ["21.0", "0"]
    assert _ask(tmp_path) == ["21.0", "1"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("constant", "read"),
    [
        ("ADDED = {}", "from constants import ADDED"),
        pytest.param(
            "ADDED = ({},)",
            "from constants import ADDED as ADDED_\nADDED, = ADDED_",
            marks=pytest.mark.nightly,
        ),
    ],
)
def test_change_of_an_imported_constant_reaches_the_kernel(
    tmp_path: Path, constant: str, read: str
) -> None:
    (tmp_path / "constants.py").write_text(constant.format(1))
    (tmp_path / "middle.py").write_text(
        f"from eskin.kernels.jit import part\n{read}\n@part\ndef middle(x):\n    return x + ADDED\n"
    )
    (tmp_path / "outer.py").write_text(OUTER)
    assert _ask(tmp_path) == ["2.0", "0"]
    assert _ask(tmp_path) == ["2.0", "1"]
    (tmp_path / "constants.py").write_text(constant.format(20))
    assert _ask(tmp_path) == ["21.0", "0"]


def test_kernel_runs_where_nothing_can_be_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(Dispatcher, "enable_caching", refuse)
    assert kernel(lambda x: x + 1.0)(2.0) == 3.0


def test_second_start_compiles_nothing(tmp_path: Path) -> None:
    code = (
        "import eskin, sys\n"
        "from numba.core import event\n"
        "with event.install_recorder('numba:compile') as seen:\n"
        "    x = eskin.Interval([1.0, 2.0], [2.0, 3.0])\n"
        "    (x + x).sqrt()\n"
        "print(len(seen.buffer))\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    counts = [
        int(
            subprocess.run(
                [sys.executable, "-c", code],
                env=environment, capture_output=True, text=True, check=True,
            ).stdout
        )
        for _ in range(2)
    ]  # fmt: skip
    assert counts[0] > 0
    assert counts[1] == 0


def test_part_answers_python_before_and_after_a_kernel_takes_it() -> None:
    @part
    def doubled(x: float) -> float:
        return 2.0 * x

    @kernel
    def quadrupled(x: float) -> float:
        return doubled(doubled(x))

    assert doubled(1.5) == 3.0
    assert quadrupled(1.5) == 6.0
    assert doubled(2) == 4.0
    assert quadrupled(2) == 8.0
