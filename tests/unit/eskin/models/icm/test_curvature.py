"""What the test of an edge proves holds at every member of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.kernels.jit import part
from eskin.models.icm.clock import REACH, sample_at
from eskin.models.icm.curvature import edge_of, waning
from eskin.models.icm.curvature import test_edge as judge_edge
from eskin.models.icm.response import branch, phase_parts, respond
from tests.unit.eskin.models.icm import reference

if TYPE_CHECKING:
    from tests.unit.eskin.models.icm.reference import Floats

N = 10_000
MEMBERS = 65


@part
def _judge(
    f: float, psi: float, t: float, taus: Floats, power: int, values: Floats, slopes: Floats
) -> tuple[bool, float, float, float]:
    """Values and slopes at the members; the verdict, its two bounds, and the sum of sizes."""
    phase, now, tau_a, tau_b = phase_parts(psi), sample_at(f, t), taus[0], taus[-1]
    most = 0.0
    for j in range(taus.size):
        h, d, size, _, _ = respond(branch(f, taus[j]), phase, now)
        weight = taus[j] / tau_a if power == 1 else 1.0
        values[j], slopes[j] = weight * h, weight * (h + d if power == 1 else d)
        most = max(most, weight * size)
    a, b = branch(f, tau_a), branch(f, tau_b)
    _, _, _, s, _ = respond(a, phase, now)
    _, _, _, s_last, left = respond(b, phase, now)
    edge = edge_of(a, b, tau_a, tau_b, power, phase)
    reach = min(1.0, phase[2] + phase[3] * now[REACH])
    sure, over, k = judge_edge(edge, power, slopes[0], slopes[-1], s, waning(s_last, left), reach)
    return sure, over, k, most


@pytest.mark.parametrize("power", [0, 1])
def test_a_sure_edge_is_monotone_and_its_bounds_hold(power: int) -> None:
    boxes = reference.cases(7, N, coil=False)
    growth = 10.0 ** np.random.default_rng(7).choice([0.05, 0.2, 1.0, 3.0], N)
    values, slopes = np.empty((2, MEMBERS))
    share = np.linspace(0.0, 1.0, MEMBERS)
    verdicts = 0
    for i in range(N):
        tau = boxes.r.inf[i] * boxes.other.inf[i]
        taus = tau * growth[i] ** share
        sure, over, k, size = _judge(
            boxes.f[i], boxes.psi[i], boxes.t[i], taus, power, values, slopes
        )
        noise = 1e-14 * size + 1e-300
        verdicts += sure
        if sure:
            assert slopes.min() >= -noise or slopes.max() <= noise
        assert values.max() <= max(values[0], values[-1]) + over + noise
        assert values.min() >= min(values[0], values[-1]) - over - noise
        bowed = np.abs(slopes - slopes[0] - share * (slopes[-1] - slopes[0]))
        assert np.all(bowed <= k * share * (1.0 - share) + noise)
    assert verdicts > 0.4 * N
