"""Monitors that run on a node: as desired and reported, by their latest verdict, with an output."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import pytest
from eskin_cloud.schemas.node_monitors import describe_node_monitors
from eskin_cloud.store.schema.tables import node_verdicts
from eskin_cloud.store.write.commands import encode_state
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import select

from eskin.interval import Verdict
from eskin.wire.timestamp import format_timestamp
from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.messages import DT, NODE, START, status, verdict
from tests.unit.cloud.orders import order, result

if TYPE_CHECKING:
    from eskin.wire.messages.command import State
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

FORMULA: Final = "t01.capacitance > 95 pF"
CERTAIN, POSSIBLE, IMPOSSIBLE = Verdict.CERTAIN, Verdict.POSSIBLE, Verdict.IMPOSSIBLE


def runs(on: str = "possible", output: str = "stop", formula: str = FORMULA) -> dict[str, Any]:
    return {"formula": formula, "on": on, "output": output}


def state(**monitors: dict[str, Any]) -> State:
    return {f"monitor:{name}": settings for name, settings in monitors.items()}


async def listed(stand: Stand) -> list[Any]:
    answer = await stand.get(f"/api/v1/nodes/{NODE}/monitors")
    assert answer.status_code == 200, answer.text
    document = answer.json()
    assert document["next"] is None
    items: list[Any] = document["items"]
    return items


async def levels(stand: Stand) -> dict[str, str | None]:
    return {each["name"]: each["level"] for each in await listed(stand)}


async def test_monitor_is_listed_with_its_latest_verdict_and_its_output(stand: Stand) -> None:
    put(stand.cloud.store, status(0), result(1, 0, state=state(squeeze=runs())))
    (before,) = await listed(stand)
    assert (before["latest"], before["level"]) == (None, None)
    put(stand.cloud.store, verdict(2, ("squeeze", CERTAIN), ("squeeze", POSSIBLE)))
    assert await listed(stand) == [
        {
            "name": "squeeze",
            **runs(),
            "desired": None,
            "reported": runs(),
            "latest": {
                "verdict": "possible",
                "time": {"lo": format_timestamp(START), "hi": format_timestamp(START + DT)},
                "final": True,
                "because": ["width"],
                "coverage": 0.75,
                "current": True,
            },
            "level": "on",
        }
    ]
    put(stand.cloud.store, verdict(3, ("squeeze", IMPOSSIBLE)))
    assert await levels(stand) == {"squeeze": "off"}


async def test_late_message_states_no_later_verdict(stand: Stand) -> None:
    said = state(squeeze=runs(on="certain"))
    put(stand.cloud.store, status(0), result(1, 0, state=said), verdict(9, ("squeeze", CERTAIN)))
    put(stand.cloud.store, verdict(5, ("squeeze", IMPOSSIBLE)))
    assert await levels(stand) == {"squeeze": "on"}
    put(stand.cloud.store, verdict(10, ("squeeze", POSSIBLE)))
    assert await levels(stand) == {"squeeze": "off"}
    put(stand.cloud.store, status(0, boot=2), verdict(1, ("squeeze", CERTAIN), boot=2))
    assert await levels(stand) == {"squeeze": "on"}


async def test_output_of_a_node_that_started_anew_or_is_silent_is_unknown(stand: Stand) -> None:
    put(stand.cloud.store, status(0), result(1, 0, state=state(squeeze=runs())))
    put(stand.cloud.store, verdict(2, ("squeeze", CERTAIN)))
    (running,) = await listed(stand)
    assert running["level"] == "on"
    stand.clock.turn(stand.cloud.settings.nodes.late_s)
    past = running | {"level": None, "latest": running["latest"] | {"current": False}}
    assert await listed(stand) == [past]
    stand.clock.turn(-stand.cloud.settings.nodes.late_s)
    assert await listed(stand) == [running]
    put(stand.cloud.store, status(0, boot=2))
    assert await listed(stand) == [past]


async def test_monitor_that_is_defined_anew_has_no_verdict_yet(stand: Stand) -> None:
    said = state(squeeze=runs(), other=runs(output="out1"))
    put(stand.cloud.store, status(0), result(1, 0, state=said))
    put(stand.cloud.store, verdict(2, ("squeeze", CERTAIN), ("other", CERTAIN)))
    put(stand.cloud.store, result(3, 0, state=said))
    assert await levels(stand) == {"squeeze": "on", "other": "on"}
    anew = said | state(squeeze=runs(formula="t01.capacitance > 99 pF"))
    put(stand.cloud.store, result(4, 0, state=anew))
    squeeze = (await listed(stand))[1]
    assert (squeeze["formula"], squeeze["latest"]) == ("t01.capacitance > 99 pF", None)
    assert await levels(stand) == {"squeeze": None, "other": "on"}
    put(stand.cloud.store, verdict(5, ("squeeze", IMPOSSIBLE)))
    put(stand.cloud.store, result(6, 0, state=state(other=runs(output="out1"))))
    assert await levels(stand) == {"other": "on"}
    with stand.cloud.store.read() as connection:
        kept = connection.execute(select(node_verdicts.c.monitor)).scalars().all()
    assert kept == ["other"]


async def test_verdict_after_a_definition_of_the_same_batch_counts(stand: Stand) -> None:
    put(
        stand.cloud.store, status(0), verdict(1, ("squeeze", IMPOSSIBLE)),
        result(2, 0, state=state(squeeze=runs())), verdict(3, ("squeeze", CERTAIN)),
    )  # fmt: skip
    assert await levels(stand) == {"squeeze": "on"}
    anew = state(squeeze=runs(on="certain"))
    put(stand.cloud.store, verdict(4, ("squeeze", POSSIBLE)), result(5, 0, state=anew))
    assert await levels(stand) == {"squeeze": None}


async def test_definition_that_comes_late_keeps_later_verdicts(stand: Stand) -> None:
    put(stand.cloud.store, status(0), verdict(2, ("squeeze", CERTAIN)))
    put(stand.cloud.store, result(1, 0, state=state(squeeze=runs())))
    assert await levels(stand) == {"squeeze": "on"}


async def test_desired_monitor_is_listed_before_it_is_reported(stand: Stand) -> None:
    put(stand.cloud.store, status(0), result(1, 0, state=state(old=runs(), gone={"on": "never"})))
    arguments = {"monitor": "squeeze", **runs("certain", "out2")}
    answer = await order(stand, {"name": "monitor", "arguments": arguments})
    assert answer.status_code == 202
    await order(stand, {"name": "monitor", "arguments": {"monitor": "old"}})
    old, squeeze = await listed(stand)
    assert (old["desired"], old["reported"], old["level"]) == (None, runs(), None)
    assert squeeze == {
        "name": "squeeze",
        **runs("certain", "out2"),
        "desired": runs("certain", "out2"),
        "reported": None,
        "latest": None,
        "level": None,
    }


async def test_unknown_node_is_refused(stand: Stand) -> None:
    answer = await stand.get(f"/api/v1/nodes/{NODE}/monitors")
    assert problem(answer, 404)
    put(stand.cloud.store, status(0))
    assert await listed(stand) == []


async def test_what_no_node_may_report_is_left_out(stand: Stand) -> None:
    said = state(
        bare={}, odd=runs(on="sometimes"), wide=runs(output="out9"), good=runs(output="none")
    )
    put(stand.cloud.store, status(0), result(1, 0, state=said), verdict(2, ("good", CERTAIN)))
    (good,) = await listed(stand)
    assert (good["name"], good["level"], good["latest"]["verdict"]) == ("good", None, "certain")


MONITOR: Final = st.tuples(
    st.sampled_from(["possible", "certain"]),
    st.sampled_from(["none", "stop", "out1"]),
    st.none() | st.tuples(st.sampled_from(list(Verdict)), st.integers(1, 2)),
)


@given(monitors=st.lists(MONITOR, max_size=5), online=st.booleans())
def test_level_is_that_of_all_monitors_of_an_output(
    *, monitors: list[tuple[str, str, tuple[Verdict, int] | None]], online: bool
) -> None:
    reported = state(**{f"m{k}": runs(on, output) for k, (on, output, _) in enumerate(monitors)})
    stated: dict[str, Any] = {
        f"m{k}": {
            "verdict": each[2][0].name.lower(),
            "boot": each[2][1],
            "t_lo": START,
            "t_hi": START,
            "coverage": 1.0,
            "detail": f'{{"monitor":"m{k}","final":true,"because":[]}}',
        }
        for k, each in enumerate(monitors)
        if each[2] is not None
    }
    row = {"desired": None, "reported": encode_state(reported)}
    found = describe_node_monitors(row, stated, boot=2, online=online)
    # Every verdict that a monitor may have now decides; the level is stated where all agree.
    for document in found:
        may = {"off"}
        for on, output, said in monitors:
            if output != document.output:
                continue
            known = online and said is not None and said[1] == 2
            verdicts = [said[0]] if known and said is not None else list(Verdict)
            asks = {each >= Verdict[on.upper()] for each in verdicts}
            may = {"on" if before == "on" or ask else "off" for before in may for ask in asks}
        expected = may.pop() if len(may) == 1 and document.output != "none" else None
        assert document.level == expected
