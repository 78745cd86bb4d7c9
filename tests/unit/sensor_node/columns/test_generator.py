"""Random numbers of columns are functions of seed, taxel, boot and instant."""

from __future__ import annotations

import numpy as np
import pytest
from eskin_sensor_node.kinds.generator import ColumnGenerator, block
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.kernels.jit import kernel

PHILOX = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000",
     "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff",
     "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0",
     "d16cfe09 94fdcceb 5001e420 24126ea1"),
]  # fmt: skip
"""Counter, key and result of Philox4x32-10: the known answers of its authors' Random123."""
seeds = st.integers(0, 2**63 - 1)


@kernel
def encrypt(low: np.uint64, high: np.uint64, key: np.uint64) -> tuple[np.uint64, np.uint64]:
    return block(low, high, key)


def word_pair(words: str) -> np.uint64:
    low, high = (int(word, 16) for word in words.split())
    return np.uint64(high << 32 | low)


@pytest.mark.parametrize(("counter", "key", "result"), PHILOX)
def test_blocks_are_those_of_philox(counter: str, key: str, result: str) -> None:
    found = encrypt(word_pair(counter[:17]), word_pair(counter[18:]), word_pair(key))
    assert tuple(map(int, found)) == (int(word_pair(result[:17])), int(word_pair(result[18:])))


@given(seeds, st.integers(0, 2**20), st.lists(st.integers(0, 2**40), min_size=1, max_size=5))
@settings(max_examples=25, deadline=None)
def test_a_draw_depends_on_its_taxel_and_instant_alone(
    seed: int, boot: int, instants: list[int]
) -> None:
    taxels, times = np.array([5, 0, 2**31]), np.array(instants)
    together = ColumnGenerator(seed, taxels)
    together.begin(boot, times)
    uniform, normal = together.uniform(0.0, 1.0), together.normal(0.0, 1.0)
    for row, k in np.ndindex(uniform.shape):
        alone = ColumnGenerator(seed, taxels[row : row + 1])
        alone.uniform(-1.0, 1.0)  # parts that are drawn before change no noise
        alone.begin(boot, times[k : k + 1])
        assert alone.uniform(0.0, 1.0).tolist() == [[uniform[row, k]]]
        assert alone.normal(0.0, 1.0).tolist() == [[normal[row, k]]]


@given(seeds, st.integers(0, 100))
@settings(max_examples=10, deadline=None)
def test_draws_are_spread_as_they_should_be_and_none_is_drawn_twice(seed: int, boot: int) -> None:
    generator = ColumnGenerator(seed, np.arange(40))
    parts = [generator.uniform(0.0, 1.0) for _ in range(100)]
    noise = []
    for each in (boot, boot + 1):
        generator.begin(each, np.arange(100))
        noise += [generator.uniform(0.0, 1.0), generator.uniform(0.0, 1.0)]
    drawn = np.concatenate([np.concatenate(parts), *noise], axis=None)
    assert len(np.unique(drawn)) == drawn.size == 4 * 4000 + 4000
    assert 0.0 <= drawn.min() < 0.01
    assert 0.99 < drawn.max() < 1.0
    assert abs(drawn.mean() - 0.5) < 6.0 * np.sqrt(1.0 / 12.0 / drawn.size)
    normal = generator.normal(2.0, 3.0)
    assert abs(normal.mean() - 2.0) < 6.0 * 3.0 / np.sqrt(normal.size)
    assert abs(normal.std() / 3.0 - 1.0) < 0.1
