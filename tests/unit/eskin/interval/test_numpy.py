"""An interval behaves as an array does, with numpy from both sides."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eskin.errors import IntervalError
from eskin.interval import Interval, Verdicts
from eskin.peaks import find_peaks

X = Interval([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]])


def same(a: Interval, b: Interval) -> bool:
    return a.shape == b.shape and bool(np.all(a.equal(b)))


def test_shape_and_indexing_are_numpys() -> None:
    assert (X.shape, X.ndim, X.size, len(X)) == ((2, 3), 2, 6, 2)
    assert X.T.shape == (3, 2)
    assert X[1].shape == (3,)
    assert same(X[:, 1], Interval([2.0, 5.0], [2.5, 5.5]))
    assert same(X[X.inf > 3.0], Interval([4.0, 5.0, 6.0], [4.5, 5.5, 6.5]))
    assert X.reshape(3, 2).shape == X.reshape(-1, 2).shape == (3, 2)
    assert X.reshape((3, 2)).shape == (3, 2)
    assert X.ravel().shape == (6,)
    assert [row.shape for row in X] == [(3,), (3,)]
    with pytest.raises(TypeError, match="no length"):
        len(Interval(1.0))


def test_broadcasting_is_numpys_and_a_misfit_is_named() -> None:
    column = Interval([[1.0], [2.0]])
    assert (X + column).shape == (2, 3)
    assert (X * Interval([1.0, 2.0, 3.0])).shape == (2, 3)
    assert (column * Interval([1.0, 2.0, 3.0])).shape == (2, 3)
    assert same((X * 2.0)[0], X[0] * Interval([2.0, 2.0, 2.0]))
    with pytest.raises(IntervalError, match="do not fit"):
        X + Interval([1.0, 2.0])


def test_every_layout_gives_the_same() -> None:
    wide = Interval(np.arange(5000.0), np.arange(5000.0) + 1.0)
    strided = Interval._trusted(wide.inf[::2], wide.sup[::2])
    assert same(strided * strided, Interval(wide.inf[::2].copy(), wide.sup[::2].copy()).sqr())
    assert same((X.T + 1.0).T, X + 1.0)
    assert same((3.0 / (wide + 1.0))[4000:4001], 3.0 / (wide[4000:4001] + 1.0))


def test_broadcast_and_read_only_bounds_are_taken_without_a_warning() -> None:
    rising = np.arange(4.0)
    for x in (
        Interval(rising, 9.0),
        Interval(*np.broadcast_arrays(rising, np.array([9.0]))),
    ):
        assert same(x + 0.0, x)
        assert same(x.sum(), Interval(x.inf.sum(), x.sup.sum()))
        assert len(find_peaks(x.ravel(), prominence=1e9)) == 0


def test_joined_intervals_keep_their_order() -> None:
    assert same(Interval.stack([X[0], X[1]]), X)
    assert Interval.concatenate([X, X], axis=1).shape == (2, 6)
    with pytest.raises(IntervalError, match="do not join"):
        Interval.stack([X, X[0]])


def test_numpy_arrays_and_scalars_mix_from_both_sides() -> None:
    x, array = Interval([1.0, 2.0], [1.5, 2.5]), np.array([2.0, 4.0])
    for left, right in (
        (array * x, x * array),
        (np.float64(2) + x, x + 2.0),
        (array - x, -x + array),
        (array / x, x.recip() * array),
        (np.int64(2) * x, x + x),
        (np.sqrt(x), x.sqrt()),
        (np.exp(x), x.exp()),
        (np.arctan2(x, 1.0), x.atan2(1.0)),
        (np.minimum(array, x), x.min(array)),
        (np.square(x), x.sqr()),
        (np.abs(-x), x),
        (2.0**x, Interval(2.0).pow(x)),
    ):
        assert isinstance(left, Interval)
        assert np.allclose(left.inf, right.inf, rtol=1e-15)
        assert np.allclose(left.sup, right.sup, rtol=1e-15)
    compared: object = array < x
    assert isinstance(compared, Verdicts)


def test_whole_powers_take_negative_bases_however_they_are_written() -> None:
    base = Interval(-3.0, 2.0)
    for exponent in (2, 2.0, np.int64(2), np.float64(2.0), np.array(2)):
        assert same(base**exponent, Interval(0.0, 9.0))
        powered: Any = np.power(base, exponent)
        assert same(powered, Interval(0.0, 9.0))
    assert Interval(0.0, 2.0).sqrt().subset(base**0.5)
    with pytest.raises(IntervalError, match="no integer"):
        base.pown(2.5)  # type: ignore[arg-type]  # a wrong call on purpose


def test_what_would_lose_bounds_says_what_to_do() -> None:
    with pytest.raises(IntervalError, match=r"\.inf, \.sup or \.mid"):
        np.asarray(X)
    with pytest.raises(IntervalError, match="logaddexp"):
        np.logaddexp(X, X)
    with pytest.raises(IntervalError, match=r"add\.reduce"):
        np.add.reduce(X)
    with pytest.raises(IntervalError, match="median"):
        np.median(X)
    with pytest.raises(IntervalError, match="out"):
        np.sqrt(X, out=np.empty((2, 3)))
    with pytest.raises(TypeError):
        hash(X)


def test_reductions_are_numpys() -> None:
    total: Any = np.sum(X)
    assert same(total, Interval(21.0, 24.0))
    assert same(np.sum(X, axis=0), Interval([5.0, 7.0, 9.0], [6.0, 8.0, 10.0]))
    assert X.sum(axis=(0, 1), keepdims=True).shape == (1, 1)
    assert np.sum(X, axis=-1, keepdims=True).shape == (2, 1)
    average: Any = np.mean(X, axis=1)
    assert same(average, Interval([2.0, 5.0], [2.5, 5.5]))
    for least in (np.min(X), X.min(), X.min(axis=1)[0], X.min(1).min(0)):
        assert same(least, Interval(1.0, 1.5))
    for greatest in (np.max(X), X.max(), X.max((0, 1)), np.amax(X, axis=0)[2]):
        assert same(greatest, Interval(6.0, 6.5))
    lesser: Any = np.minimum(X, 2.0)
    assert same(X.min(Interval(2.0)), lesser)
    assert Interval.stack([X[0], Interval.empty(3)]).max(axis=0).is_empty.all()
    with pytest.raises(IntervalError, match=r"axis 2 of shape \(2, 3\)"):
        X.sum(axis=2)
    with pytest.raises(IntervalError, match="no intervals"):
        Interval([]).min()


def test_sum_of_nothing_is_a_plain_zero() -> None:
    nothing = Interval([]).sum()
    assert nothing.inf == nothing.sup == 0.0
    assert not np.signbit([nothing.inf, nothing.sup]).any()
    assert Interval([]).mean().is_empty
    assert X.dtype == np.float64


def test_copies_and_pickles_are_equal() -> None:
    for other in (X.copy(), copy.deepcopy(X), pickle.loads(pickle.dumps(X))):  # noqa: S301 - our own
        assert same(other, X)
        assert other.inf is not X.inf


def test_thin_intervals_stay_thin() -> None:
    x = np.linspace(0.1, 10.0, 1000)
    result = (Interval(x) * 3.0 + 1.0).sqrt().exp().log()
    assert float(np.max(result.wid / result.mid)) < 1e-13


def test_documented_example_runs() -> None:
    text = (Path(__file__).parents[4] / "docs" / "intervals.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    names: dict[str, object] = {}
    exec(compile(code, "docs/intervals.md", "exec"), names)  # noqa: S102 - our own documentation
    frequency, same = names["frequency"], names["same"]
    assert isinstance(frequency, Interval)
    assert isinstance(same, Interval)
    assert np.all(np.abs(frequency.inf - same.inf) <= 8 * np.spacing(same.inf))
    assert "peak" in names
