"""Runs of TLC over modules of ``docs/model``."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

ROOT: Final = Path(__file__).parents[3]
MODULES: Final = ROOT / "docs" / "model"
_JARS: Final = ROOT / ".venv" / "tlc"
_COUNTS: Final = re.compile(r"([\d,]+) states generated, ([\d,]+) distinct states found")
_BROKEN: Final = re.compile(r"(?:Invariant (\w+) is violated|(Temporal properties were violated))")
_STATE: Final = re.compile(r"^State (\d+)", re.MULTILINE)
_DEADLOCK: Final = "Deadlock reached"
_COMPLETE: Final = "Model checking completed. No error has been found."


class TlcError(Exception):
    """TLC could not check a module; shows the end of its output."""


@dataclass(frozen=True, slots=True)
class Result:
    """What TLC found.

    Attributes:
        broken: The violated invariant, ``deadlock`` or ``liveness``; ``None`` if nothing is.
        length: States of the counterexample.
        generated: States that were generated.
        distinct: Distinct ones among them.
        output: All that TLC printed.
    """

    broken: str | None
    length: int
    generated: int
    distinct: int
    output: str

    def last(self, variable: str) -> int:
        """The value of a number in the last state of the counterexample."""
        return int(re.findall(rf"^/\\ {variable} = (\d+)$", self.output, re.MULTILINE)[-1])


def find_jar() -> Path | None:
    """The jar of TLC that ``make model`` installed; ``None`` if there is none."""
    return next(iter(sorted(_JARS.rglob("tla2tools.jar"))), None)


def check(
    modules: Mapping[str, str],
    root: str,
    configuration: Sequence[str],
    *,
    deadlock: bool = False,
    seconds: float = 300.0,
) -> Result:
    """Check a module with TLC.

    Args:
        modules: Texts of modules by name.
        root: The one to check.
        configuration: Lines of its configuration.
        deadlock: Whether a state without a successor is an error.
        seconds: Most time.

    Raises:
        TlcError: There is no TLC, the module is invalid, or the time is over.
    """
    jar, java = find_jar(), shutil.which("java")
    if jar is None or java is None:
        raise TlcError("no TLC is installed; run: make model")
    with tempfile.TemporaryDirectory(prefix="eskin-model-") as name:
        folder = Path(name)
        for module, text in modules.items():
            (folder / f"{module}.tla").write_text(text)
        (folder / f"{root}.cfg").write_text("\n".join(configuration) + "\n")
        words = [java, "-Xmx3g", "-XX:+UseParallelGC", f"-Djava.io.tmpdir={folder}"]
        words += [
            "-cp",
            str(jar),
            "tlc2.TLC",
            "-workers",
            "2",
            "-lncheck",
            "final",
            "-metadir",
            str(folder / "states"),
        ]
        words += ([] if deadlock else ["-deadlock"]) + [root]
        try:
            ended = subprocess.run(
                words, cwd=folder, capture_output=True, text=True, timeout=seconds, check=False
            )
        except subprocess.TimeoutExpired as error:
            said = error.stdout.decode() if isinstance(error.stdout, bytes) else ""
            raise TlcError(f"{root}: not done in {seconds:g} s:\n{said[-300:]}") from error
    return _read(root, ended.stdout)


def _read(root: str, output: str) -> Result:
    counts, broken = _COUNTS.findall(output), _BROKEN.search(output)
    generated, distinct = (int(n.replace(",", "")) for n in counts[-1]) if counts else (0, 0)
    name = None
    if broken is not None:
        name = broken.group(1) or "liveness"
    elif _DEADLOCK in output:
        name = "deadlock"
    elif _COMPLETE not in output:
        raise TlcError(f"{root}: TLC failed:\n{output[-3000:]}")
    length = max((int(n) for n in _STATE.findall(output)), default=0) if name else 0
    return Result(name, length, generated, distinct, output)
