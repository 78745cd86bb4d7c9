"""Gestures against their truth: templates over intervals, and a classifier over the middles.

``python -m benchmarks.gestures --count 10000`` plays gestures on emulated skins of pads: a
grid of 256 taxels, and a dense one of 576 for two fingers. A quarter is clean (no broken taxel,
the noise of the data sheet, least pressure three times the threshold), a quarter has more noise, a
quarter broken taxels, and a quarter is strange: times and ways are drawn without regard to the
templates. What a record holds is decided by its noise-free pressures, not by its script.

The classifier is tuned by cross-validation on training records, of other seeds. It always answers.
`TEST_SEED` draws the gestures: it follows from the hash of the templates, which were fixed before.
Exit status 1 if a certain answer is wrong, a true gesture is impossible, or fewer than 95 % of
the clean ones are certain.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.gestures.classifier import fit
from benchmarks.gestures.features import features
from benchmarks.gestures.judge import NONE, SEVERAL, Answer, judge, label_of, truth_of
from benchmarks.gestures.scenes import CONDITIONS, Record, Skins
from eskin.gestures.templates import PAIR_KINDS, TOUCH_KINDS
from eskin.interval import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

TRAINING_SEED: Final = 101
"""Of the records that the classifier learns from."""
TEMPLATES: Final = "64f22afdd937be280b5c2affcb82120f351bb6c0"
"""Git's hash of the folder ``eskin/gestures`` in the commit that fixed the templates, "Recognise
gestures on contacts with three verdicts"; it stays the same where the commit is rebased."""
TEST_SEED: Final = int(TEMPLATES[:12], 16)
"""Drawn from it, so that the templates were fixed before."""
_KINDS: Final = (*TOUCH_KINDS, *PAIR_KINDS, NONE, SEVERAL)
_NEEDED: Final = 0.95

Rows = list[tuple[str, Answer, list[float]]]


def play(count: int, seed: int) -> Iterator[tuple[str, Record]]:
    """Play so many gestures, evenly of all conditions; gives condition and record."""
    with tempfile.TemporaryDirectory() as folder:
        skins = Skins(Path(folder))
        for number, condition in enumerate(CONDITIONS):
            own = (count + number) // len(CONDITIONS)
            records = skins.play(condition, own, seed * len(CONDITIONS) + number)
            for record in track(records, condition.name, total=own, console=Console(stderr=True)):
                yield condition.name, record


def main() -> int:
    """Train, play, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gestures", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="gestures")
    parser.add_argument("--train", type=int, help="training records; default: a quarter")
    parser.add_argument("--seed", type=int, default=TEST_SEED, help=f"not {TRAINING_SEED}")
    options = parser.parse_args()
    if options.seed == TRAINING_SEED:
        parser.error(f"seed {TRAINING_SEED} is that of the training records")
    begun = time.monotonic()
    labels, known = [], []
    for _, record in play(options.train or options.count // 4, TRAINING_SEED):
        labels.append(label_of(truth_of(record))[0])
        known.append(features(record))
    model, name = fit(np.array(known), labels)
    rows = [
        (condition, judge(record), features(record))
        for condition, record in play(options.count, options.seed)
    ]
    guesses = [str(each) for each in model.predict(np.array([row for _, _, row in rows]))]
    console = Console(width=120)
    console.print(f"classifier: {name}, of {len(known)} records", highlight=False)
    for condition in CONDITIONS:
        console.print(table_of(condition.name, rows, guesses))
    console.print(f"templates of tree {TEMPLATES}", highlight=False)
    console.print(f"{len(rows)} gestures, seed {options.seed}, {time.monotonic() - begun:.0f} s")
    return 1 if failed(rows) else 0


def table_of(condition: str, rows: Rows, guesses: Sequence[str]) -> Table:
    """The answers of a condition, a row a label."""
    table = Table(title=condition)
    for head in (
        "truth", "records", "certain", "possible", "missed", "certain %", "certain, wrong",
        "classifier right %", "classifier wrong",
    ):  # fmt: skip
        table.add_column(head, justify="left" if head == "truth" else "right")
    own = [
        (answer, guess)
        for (name, answer, _), guess in zip(rows, guesses, strict=True)
        if name == condition
    ]
    for kind in (*_KINDS, "all"):
        some = [each for each in own if kind in {each[0].label, "all"}]
        if not some:
            continue
        verdicts = Counter(answer.verdict for answer, _ in some)
        right = sum(answer.label == guess for answer, guess in some)
        table.add_row(
            kind,
            *map(str, (len(some), *(verdicts[each] for each in reversed(Verdict)))),
            f"{100.0 * verdicts[Verdict.CERTAIN] / len(some):.1f}",
            str(sum(answer.wrong for answer, _ in some)),
            f"{100.0 * right / len(some):.1f}",
            str(len(some) - right),
            end_section=kind == _KINDS[-1],
        )
    return table


def failed(rows: Rows) -> bool:
    """Whether a promise is broken."""
    clean = [answer.verdict for name, answer, _ in rows if name == "clean"]
    share = sum(each is Verdict.CERTAIN for each in clean) / max(len(clean), 1)
    return share < _NEEDED or any(
        answer.wrong or answer.verdict is Verdict.IMPOSSIBLE for _, answer, _ in rows
    )


if __name__ == "__main__":
    sys.exit(main())
