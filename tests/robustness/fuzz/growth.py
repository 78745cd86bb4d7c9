"""What a target's memory does, in a process in which nothing watches the branches.

The instruments that libFuzzer needs keep some bytes for each input themselves: 150 MiB in a million
of recordings, where the same inputs without them leave memory as it was.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

import psutil

from tests.robustness.fuzz.mutations.octets import mutate_octets
from tests.robustness.fuzz.run import BrokenError
from tests.robustness.fuzz.target import load

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.robustness.fuzz.target import Target

_WARM: Final = 0.2
"""Share of the inputs after which memory must not grow any more."""
_BLIND: Final = 0.25
"""Share of changes that know nothing of how an input is made."""


def grown(target: Target, pool: Sequence[bytes], *, inputs: int, seed: int) -> int:
    """Bytes by which memory grew, trying changes of inputs.

    Args:
        target: What they are tried on.
        pool: The inputs, such as those that reached something new.
        inputs: How many changes.
        seed: Draws them.

    Raises:
        BrokenError: One broke the oracle.
    """
    process, random, warm = psutil.Process(), Random(seed), 0
    for data in pool:  # each loads what it needs first
        target.check(data)
    for number in range(inputs):
        data = random.choice(pool)
        blind = random.random() < _BLIND
        changed = mutate_octets(data, random) if blind else target.mutate(data, random)
        try:
            target.check(changed)
        except Exception as error:
            raise BrokenError(changed) from error
        if number <= inputs * _WARM:
            warm = process.memory_info().rss
    found: int = process.memory_info().rss
    return found - warm


def main() -> None:
    """Print the bytes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--target", required=True)
    parser.add_argument("--inputs", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--folder", type=Path, required=True, help="has a corpus; takes findings")
    parser.add_argument("--scratch", type=Path, required=True, help="for the target's own files")
    options = parser.parse_args()
    pool = [path.read_bytes() for path in sorted((options.folder / "corpus").iterdir())]
    target = load(options.target, options.scratch)
    with target.stack:
        try:
            found = grown(target, pool, inputs=options.inputs, seed=options.seed)
        except BrokenError as error:
            (options.folder / "broken-again").write_bytes(error.data)
            raise
    sys.stdout.write(f"{found}\n")


if __name__ == "__main__":
    main()
