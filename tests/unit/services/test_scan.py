"""`make scan` fails for what is known to be vulnerable, or where nothing could be asked."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

    Scan = Callable[..., subprocess.CompletedProcess[str]]

ROOT = Path(__file__).parents[3]
DASHBOARD = "cloud/dashboard"


@pytest.fixture
def scan(tmp_path: Path) -> Scan:
    """Scans with an npm that answers so, and ends with a status."""

    def run(answer: str, status: int, folder: str = DASHBOARD) -> subprocess.CompletedProcess[str]:
        (tmp_path / "answer").write_text(answer)
        programs = {"node": "echo v22.1.0", "npm": f"cat {tmp_path}/answer; exit {status}"}
        for name, does in programs.items():
            (tmp_path / name).write_text(f"#!/bin/sh\n{does}\n")
            (tmp_path / name).chmod(0o755)
        return subprocess.run(
            [ROOT / "services" / "scan_npm.sh", folder],
            env=os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"},
            capture_output=True, text=True, check=False, timeout=60,
        )  # fmt: skip

    return run


def report(vulnerable: int) -> str:
    """As npm writes it."""
    found: dict[str, Any] = {"auditReportVersion": 2, "vulnerabilities": {}}
    return json.dumps(found | {"metadata": {"vulnerabilities": {"total": vulnerable}}}, indent=2)


def test_lock_file_without_known_vulnerabilities_passes(scan: Scan) -> None:
    done = scan(report(0), 0)
    assert done.returncode == 0
    assert "no known vulnerabilities" in done.stdout


def test_known_vulnerability_fails(scan: Scan) -> None:
    done = scan(report(1), 1)
    assert done.returncode == 1
    assert "no known vulnerabilities" not in done.stdout


@pytest.mark.parametrize(
    "answer",
    [
        '{\n  "message": "404 Not Found - POST /-/npm/v1/audits",\n  "statusCode": 404\n}',
        '{"error": {"code": "ENOTFOUND", "summary": "404 Not Found"}}',
        "npm error 404 Not Found",
    ],
)
def test_registry_without_advisories_is_reported_and_fails_nothing(scan: Scan, answer: str) -> None:
    done = scan(answer, 1)
    assert done.returncode == 0
    assert "NOT SCANNED: the npm registry gives no advisories" in done.stderr
    assert "no known vulnerabilities" not in done.stdout
    assert "404 Not Found" in done.stderr or "ENOTFOUND" in done.stderr


def test_folder_without_a_lock_file_fails(scan: Scan) -> None:
    done = scan(report(0), 0, "docs")
    assert done.returncode == 1
    assert "no package-lock.json" in done.stderr
