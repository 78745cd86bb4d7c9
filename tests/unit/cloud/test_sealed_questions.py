"""Questions about sealed channels: in the unit of their frames, over all that an answer spans."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import batch, problem
from tests.unit.cloud.messages import DT, START, stretch, tube_of
from tests.unit.cloud.sealing import CHANNEL, NODE, Site, ask, declared, keyed, physician, pulse

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
TWIN = "/api/v1/series/twin/t01.capacitance"


@pytest.fixture
def stand(tmp_path: Path, identities: Identities, site: Site) -> Iterator[Stand]:
    with keyed(tmp_path, identities, site) as made:
        yield made


CAPACITANCE: Any = {
    "model": "alternating_capacitance",
    "parameter": [
        "minimum_capacitance:9e-12:1.1e-11",
        "maximum_capacitance:9e-11:1.1e-10",
        "frequency:2",
    ],
}


async def test_sealed_channel_is_compared_with_models_of_the_unit_of_its_frames(
    stand: Stand, site: Site
) -> None:
    bounds = np.full(40, 5e-9), np.full(40, 6e-9)
    sealed = pulse(1, *bounds, time=(START, START), unit="F")
    bare = stretch(1, *bounds, time=(START, START), unit="F")
    await stand.ingest(site.batch(sealed))
    await stand.ingest(batch(bare, node="twin"))
    token = physician(stand)
    window = {"start": START, "end": START + 40 * DT}
    for path in ("/anomalies", "/anomalies/time", "/prediction"):
        found = await ask(stand, token, SERIES + path, **window, **CAPACITANCE)
        plain = await ask(stand, token, TWIN + path, **window, **CAPACITANCE)
        assert found.status_code == 200, found.text
        differ = {"node": None, "channel": None}
        assert found.json() | differ == plain.json() | differ


async def test_verdicts_at_the_ends_of_a_window_are_those_of_a_channel_in_the_clear(
    stand: Stand, site: Site
) -> None:
    # START begins a minute, which is all that is stated of a sealed frame's time.
    first = START - 40 * DT + DT // 2
    said = [
        pulse(k, np.full(40, 5e-9 * k), np.full(40, 6e-9 * k), time=(t, t), unit="F")
        for k, t in enumerate((first, first + 40 * DT), 1)
    ]
    await stand.ingest(site.batch(*said))
    twins = [
        stretch(each.position.sequence, values.inf, values.sup, time=each.time, unit="F")
        for each, values in ((each, tube_of(each).values) for each in said)
    ]
    await stand.ingest(batch(*twins, node="twin"))
    window = {"start": START, "end": START + 30 * DT, "above": 7e-9}
    for path in ("/threshold", "/time"):
        found = await ask(stand, physician(stand), SERIES + path, **window)
        plain = await ask(stand, physician(stand), TWIN + path, **window)
        assert found.json() == plain.json()
    assert found.json()["unknown_s"] == 0.0


async def test_model_of_another_unit_than_that_of_sealed_frames_is_refused(
    stand: Stand, site: Site
) -> None:
    await stand.ingest(
        site.batch(declared(), pulse(1, np.ones(40), np.ones(40), time=(START, START)))
    )
    window = {"start": START, "end": START + 40 * DT}
    for path in ("/anomalies", "/anomalies/time", "/prediction"):
        answer = await ask(stand, physician(stand), SERIES + path, **window, **CAPACITANCE)
        assert "F, not V" in problem(answer, 422)


async def test_window_of_many_days_is_answered_as_that_of_a_channel_in_the_clear(
    stand: Stand, site: Site
) -> None:
    tile = 1 << 40  # of a window of 100 days, for samples at 1 kHz
    first = (START // tile + 1) * tile
    begin = first + tile // 2
    end = begin + 100 * 86_400 * SECOND
    instants = [first + SECOND, begin + SECOND, end - SECOND, end + tile // 4]
    said = [
        pulse(k, np.full(40, 10.0 * k), np.full(40, 10.0 * k + 1), time=(t, t))
        for k, t in enumerate(instants, 1)
    ]
    await stand.ingest(site.batch(declared(), *said))
    twins = [
        stretch(each.position.sequence, values.inf, values.sup, time=each.time, unit="V")
        for each, values in ((each, tube_of(each).values) for each in said)
    ]
    await stand.ingest(batch(*twins, node="twin"))
    token = physician(stand)
    for points in (1, 3, 100, 1000):
        window = {"start": begin, "end": end, "points": points}
        sealed = (await ask(stand, token, SERIES, **window)).json()
        plain = (await ask(stand, token, TWIN, **window)).json()
        differ = {"node": None, "channel": None}
        assert sealed | differ == plain | differ
