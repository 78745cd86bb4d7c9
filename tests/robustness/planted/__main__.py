"""Plant bugs one by one in a copy of the repository, and see that tests catch each.

A bug counts as caught if the tests that its patch names pass without it and fail with it. Exit
status 1 if one is not caught, or a patch does not apply.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.table import Table

from tests.robustness.planted.bugs import read_bugs
from tests.robustness.planted.copied_tree import DASHBOARD, FAILED, CopiedTree, CopyError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.robustness.planted.bugs import Bug

_WHOLE: Final = ("--numprocesses", "3", "--dist", "loadscope", "--no-loadscope-reorder")
"""How `make test` runs all tests."""


def main() -> int:
    """Plant bugs and print a table."""
    bugs = read_bugs()
    parser = argparse.ArgumentParser(prog="python -m tests.robustness.planted", description=__doc__)
    parser.add_argument(
        "--only", action="append", choices=list(bugs), metavar="BUG", help="repeatable"
    )
    parser.add_argument("--whole", action="store_true", help="run all that make test runs")
    options = parser.parse_args()
    chosen = [bugs[name] for name in options.only or bugs]
    console = Console(stderr=True)
    table = Table("bug", "result", "seconds", "caught by")
    missed = 0
    with TemporaryDirectory(prefix="eskin-planted-") as folder:
        tree = CopiedTree(Path(folder) / "tree")
        with console.status("tests without any bug"):
            status, output = _test(tree, chosen, whole=options.whole)
        if status:
            console.print(output, markup=False, highlight=False)
            console.print(f"tests fail without any bug (status {status})")
            return 1
        for bug in chosen:
            begun = time.monotonic()
            with console.status(bug.name):
                result, output = _plant(tree, bug, whole=options.whole)
            seconds = f"{time.monotonic() - begun:.0f}"
            console.print(f"{bug.name}: {result} in {seconds} s", highlight=False)
            if result != "caught":
                missed += 1
                console.print(output, markup=False, highlight=False)
            table.add_row(bug.name, result, seconds, bug.caught_by)
    Console().print(table)
    return 1 if missed else 0


def _plant(tree: CopiedTree, bug: Bug, *, whole: bool) -> tuple[str, str]:
    """The result of a bug, and the tests' output."""
    try:
        with tree.planted(bug.patch):
            status, output = _test(tree, [bug], "--exitfirst", whole=whole)
    except CopyError as error:
        return "NOT APPLIED", str(error)
    if status == 0:
        return "NOT CAUGHT", output
    return ("caught", output) if status == FAILED else (f"NOT RUN ({status})", output)


def _test(tree: CopiedTree, bugs: Sequence[Bug], *options: str, whole: bool) -> tuple[int, str]:
    """Run the tests that bugs name, or all in their languages; gives status and output."""
    status, output = 0, ""
    in_python = dict.fromkeys(bug.caught_by for bug in bugs if not bug.in_dashboard)
    if in_python:
        status, output = tree.test(*options, *(_WHOLE if whole else in_python))
    in_dashboard = dict.fromkeys(
        bug.caught_by.removeprefix(f"{DASHBOARD}/") for bug in bugs if bug.in_dashboard
    )
    if in_dashboard and not status:
        status, output = tree.test_dashboard(*(() if whole else in_dashboard))
    return status, output


if __name__ == "__main__":
    sys.exit(main())
