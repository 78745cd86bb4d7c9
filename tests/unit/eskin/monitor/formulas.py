"""Formulas of all kinds, drawn for properties."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from hypothesis import strategies as st

from eskin.monitor import (
    Absolute,
    Add,
    Always,
    And,
    Atom,
    Channel,
    Comparison,
    Constant,
    Count,
    Divide,
    Eventually,
    Expression,
    Fall,
    Formula,
    Historically,
    Implies,
    Maximum,
    Minimum,
    Multiply,
    Negate,
    Not,
    Once,
    Or,
    Rise,
    Since,
    Subtract,
    Until,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

NAMES = ("a", "t07.pressure", "node-1/t07.pressure", "not", "until")
UNITS = (None, "1", "kPa", "m/s2", "m.s-1", "%", "min")


def constants() -> st.SearchStrategy[Expression]:
    decimals = st.tuples(st.integers(-(10**20), 10**20), st.integers(-30, 30))
    numbers = decimals.map(lambda pair: pair[0] * Fraction(10) ** pair[1])
    return st.builds(Constant, numbers, st.sampled_from(UNITS))


def expressions(
    names: Sequence[str], constant: st.SearchStrategy[Expression]
) -> st.SearchStrategy[Expression]:
    channels = st.builds(Channel, st.sampled_from(names), st.sampled_from((0, 0, 5, 10**8)))
    leaves = channels | constant

    def extend(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
        pairs = [st.builds(kind, inner, inner) for kind in (Add, Subtract, Multiply, Divide)]
        several = st.lists(inner, min_size=1, max_size=3).map(tuple)
        return st.one_of(
            *pairs,
            st.builds(Negate, inner),
            st.builds(Absolute, inner),
            st.builds(Minimum, several),
            st.builds(Maximum, several),
        )

    return st.recursive(leaves, extend, max_leaves=4)


def bounds(largest: int, *, unbounded: bool) -> st.SearchStrategy[tuple[int, int | None]]:
    pair = st.tuples(st.integers(0, largest), st.integers(0, largest)).map(
        lambda both: (min(both), max(both))
    )
    if not unbounded:
        return pair
    return pair | st.integers(0, largest).map(lambda first: (first, None))


def formulas(
    atoms: st.SearchStrategy[Formula],
    windows: st.SearchStrategy[tuple[int, int | None]],
    max_leaves: int = 6,
) -> st.SearchStrategy[Formula]:
    def extend(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
        several = st.lists(inner, min_size=2, max_size=3).map(tuple)
        return st.one_of(
            st.builds(Not, inner),
            st.builds(And, several),
            st.builds(Or, several),
            st.builds(Implies, inner, inner),
            *(st.builds(kind, windows, inner) for kind in (Always, Eventually, Historically, Once)),
            st.builds(Until, windows, inner, inner),
            st.builds(Since, windows, inner, inner),
            st.builds(Rise, inner),
            st.builds(Fall, inner),
            st.builds(Count, several, st.sampled_from(Comparison), st.integers(0, 3)),
        )

    return st.recursive(atoms, extend, max_leaves=max_leaves)


def atoms(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Formula]:
    return st.builds(Atom, inner, st.sampled_from(Comparison), inner)
