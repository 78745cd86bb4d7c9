"""A copy of the repository, in which bugs are planted and tests run."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from tests.robustness.planted.bugs import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PACKAGES: Final = {
    "eskin": ".",
    "eskin_gateway": "gateway",
    "eskin_cloud": "cloud",
    "eskin_sensor_node": "sensor_node",
    "eskin_ca": "ca_service",
}
"""Folder of each package."""
DASHBOARD: Final = "cloud/dashboard"
_BUILT: Final = (
    "cloud/eskin_cloud/dashboard",
    f"{DASHBOARD}/node_modules",
    "tests/contract/micropython/node_modules",
)
"""What is built and not committed; the copy links to it."""
FAILED: Final = 1
"""pytest's exit status if tests failed; others mean that they did not run."""


class CopyError(Exception):
    """The copy cannot be used."""


class CopiedTree:
    """The last commit, in a folder of its own.

    Args:
        folder: Where it is made.

    Raises:
        CopyError: Its modules are not the ones that Python imports.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        _git(ROOT, "clone", "--quiet", "--shared", "--no-checkout", str(ROOT), str(folder))
        commit = _git(ROOT, "rev-parse", "HEAD").strip()
        _git(folder, "checkout", "--quiet", "--detach", commit)
        for name in _BUILT:
            if (ROOT / name).exists():
                (folder / name).symlink_to(ROOT / name)
        # Before the editable install, whose finder comes after the path.
        path = os.pathsep.join(str(folder / place) for place in PACKAGES.values())
        self._env = os.environ | {"PYTHONPATH": path}
        self._env.pop("PYTHONDONTWRITEBYTECODE", None)  # each run would compile all sources again
        for name in PACKAGES:
            found = self._run("-c", f"import {name}; print({name}.__file__)")
            if not found.stdout.startswith(f"{folder}{os.sep}"):
                raise CopyError(
                    f"{name} is not imported from {folder}: {found.stdout or found.stderr}"
                )

    @contextmanager
    def planted(self, patch: Path) -> Iterator[None]:
        """Apply a patch, and take it back afterwards.

        Raises:
            CopyError: It does not apply.
        """
        _git(self._folder, "apply", str(patch))
        try:
            yield
        finally:
            _git(self._folder, "apply", "--reverse", str(patch))

    def test(self, *arguments: str) -> tuple[int, str]:
        """Run pytest, whatever marks the tests have; returns its exit status and its output."""
        words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "")
        done = self._run(*words, *arguments)
        return done.returncode, done.stdout + done.stderr

    def test_dashboard(self, *arguments: str) -> tuple[int, str]:
        """Run vitest in the dashboard's folder; returns its exit status and its output."""
        folder = os.path.relpath(self._folder / DASHBOARD, ROOT)
        done = self._run_program(
            str(ROOT / "services" / "npm.sh"), folder, "test", "--", *arguments
        )
        return done.returncode, done.stdout + done.stderr

    def _run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return self._run_program(sys.executable, *arguments)

    def _run_program(self, *command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command,
            cwd=self._folder,
            env=self._env,
            capture_output=True,
            text=True,
            check=False,
        )


def _git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        ["git", *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise CopyError(done.stderr.strip())
    return done.stdout
