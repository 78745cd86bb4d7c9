"""A short run of a target in this process: seeded, so that it is the same each time."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from tests.robustness.fuzz.target import Target

_POOL: Final = 200


class BrokenError(AssertionError):
    """An input that broke its target's oracle.

    Attributes:
        data: The input.
    """

    def __init__(self, data: bytes) -> None:
        super().__init__(f"broken by {data!r}")
        self.data = data


def run(target: Target, *, inputs: int, seed: int) -> None:
    """Try the seeds, then changes of them and of their changes.

    Raises:
        BrokenError: An input broke the oracle; its cause states how.
    """
    random = Random(seed)
    pool = list(target.seeds)
    for number in range(inputs):
        if number < len(target.seeds):
            data = target.seeds[number]
        else:
            data = target.mutate(random.choice(pool), random)
        try:
            target.check(data)
        except Exception as error:
            raise BrokenError(data) from error
        if len(data) < 10_000 and number >= len(target.seeds):
            place = random.randrange(_POOL)
            if len(pool) < _POOL:
                pool.append(data)
            elif place >= len(target.seeds):
                pool[place] = data
