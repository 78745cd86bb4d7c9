"""``make powercut``: cut the power of each store, in more ways than the tests do.

Exit status 1 if one did not open again with all that was acknowledged.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import track

from tests.robustness.powercut.cuts import cut
from tests.robustness.powercut.journal import record
from tests.robustness.powercut.stores import STORES

if TYPE_CHECKING:
    from tests.robustness.powercut.cuts import Cut


def main() -> int:
    """Record, cut, tell."""
    parser = argparse.ArgumentParser(prog="make powercut", description=__doc__)
    parser.add_argument("--images", type=int, default=500, help="power cuts of each store")
    parser.add_argument("--seed", type=int, default=1, help="draws what happens")
    options = parser.parse_args()
    console = Console(stderr=True)
    wrong: list[Cut] = []
    with tempfile.TemporaryDirectory(prefix="eskin-powercut-") as fresh:
        live = Path(fresh) / "live"
        live.mkdir()
        journal = record(live, seed=options.seed)
        for name in STORES:
            cuts = cut(name, live / name, journal, images=options.images, seed=options.seed)
            shown = track(cuts, name, total=options.images, console=console)
            found = [one for one in shown if one.fault]
            for one in found[:5]:
                console.print(f"WRONG: {name}, cut at call {one.deed}: {one.fault}")
            console.print(f"{name}: {options.images} power cuts, {len(found)} with a loss")
            wrong += found
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
