"""``tests.robustness.powercut.work FOLDER SEED``: work on each store, under the journal."""

from __future__ import annotations

import random
import sys
from pathlib import Path

from tests.robustness.powercut.journal import Marks
from tests.robustness.powercut.stores import STORES

if __name__ == "__main__":
    for name, subject in STORES.items():
        folder = Path(sys.argv[1]) / name
        folder.mkdir()
        draw = random.Random(int(sys.argv[2]))  # noqa: S311 - a plan, no secret
        subject.work(folder, draw, Marks(folder))
