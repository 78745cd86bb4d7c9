"""Monitors and alarms over REST: defined, read, acknowledged, silenced, deleted."""

from __future__ import annotations

from datetime import timedelta
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.access import Scope, create_token
from eskin_cloud.alarms.receivers import (
    find_waiting,
    forget_receivers,
    note_delivered,
    register_receiver,
)
from eskin_cloud.store.schema.tables import audit_log
from eskin_cloud.store.write.alarms import advance_alarms, remove_cleared
from sqlalchemy import select

from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.live_monitors import Live
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch

if TYPE_CHECKING:
    import httpx

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
MONITOR = "/api/v1/monitors/squeeze"
BODY = {"formula": f"{CHANNEL} > 2 F", "node": NODE, "clear_after_s": 0.0}


class Operator:
    """Someone who may define monitors, and the evaluator."""

    def __init__(self, stand: Stand) -> None:
        self.stand = stand
        stand.clock.now = START
        put(stand.cloud.store, stretch(0, [1.0], [1.5], time=(START, START)))
        self.token = create_token(
            stand.cloud.store,
            scopes=[Scope.READ, Scope.OPERATE],
            name="shift",
            lifetime=timedelta(days=9),
        )
        self.live = Live(stand.cloud.store, evaluator=stand.cloud.evaluator)
        self._next, self._ms = 1, 1

    async def ask(self, method: str, path: str, body: Any = None) -> httpx.Response:
        async with self.stand.client(token=self.token) as client:
            return await client.request(method, path, json=body)

    def press(self, *values: float) -> None:
        """Samples of a millisecond each arrive, and are evaluated."""
        at = START + self._ms * DT
        lo = list(values)
        put(self.stand.cloud.store, stretch(self._next, lo, [v + 0.5 for v in lo], time=(at, at)))
        self._next, self._ms = self._next + 1, self._ms + len(lo)
        self.stand.clock.now = START + self._ms * DT
        self.live.step()
        self.live.step()

    async def alarms(self, **params: Any) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = (await self.stand.get("/api/v1/alarms", **params)).json()[
            "items"
        ]
        return found

    async def transitions(self, number: int) -> list[str]:
        answer = await self.stand.get(f"/api/v1/alarms/{number}")
        return [each["transition"] for each in answer.json()["transitions"]]

    def advance(self) -> None:
        """What the cloud does each second."""
        store, holder = self.stand.cloud.store, self.stand.cloud.evaluator.holder
        now = self.stand.clock.now
        store.write(lambda c: advance_alarms(c, holder=holder, now=now)).result(60)


@pytest.fixture
def operator(stand: Stand) -> Operator:
    return Operator(stand)


async def test_monitor_raises_one_alarm_an_episode(operator: Operator) -> None:
    answer = await operator.ask("PUT", MONITOR, BODY)
    assert answer.status_code == 200, answer.text
    assert answer.json()["latest"] is None
    operator.press(1.0, 4.0, 4.0, 4.0)
    operator.press(4.0, 1.0, 1.0)
    operator.press(4.0, 4.0)
    first, second = (await operator.alarms())[::-1]
    assert (first["state"], second["state"]) == ("cleared", "raised")
    assert first["began"] < first["ended"] < second["began"]
    assert await operator.alarms(state="raised") == [second]
    assert await operator.alarms(monitor="other") == []
    assert await operator.transitions(first["id"]) == ["raised", "cleared"]
    read = (await operator.stand.get(MONITOR)).json()
    assert (read["alarm"], read["problem"], read["latest"]["verdict"]) == (
        *(second["id"], None, "certain"),
    )
    listed = (await operator.stand.get("/api/v1/monitors")).json()["items"]
    assert listed == [read]


async def test_pages_list_each_alarm_once(operator: Operator) -> None:
    await operator.ask("PUT", MONITOR, BODY)
    operator.press(*[4.0, 4.0, 1.0, 1.0] * 5)
    found, cursor = [], None
    while True:
        params = {"limit": 2} | ({} if cursor is None else {"cursor": cursor})
        answer = (await operator.stand.get("/api/v1/alarms", **params)).json()
        found += [each["id"] for each in answer["items"]]
        cursor = answer["next"]
        if cursor is None:
            break
    assert found == [5, 4, 3, 2, 1]


async def test_changed_formula_clears_the_alarm_of_the_old_one(operator: Operator) -> None:
    await operator.ask("PUT", MONITOR, BODY)
    operator.press(4.0, 4.0)
    again = (await operator.ask("PUT", MONITOR, BODY)).json()
    assert (again["revision"], again["alarm"]) == (1, 1)
    changed = (await operator.ask("PUT", MONITOR, BODY | {"formula": f"{CHANNEL} > 3 F"})).json()
    assert (changed["revision"], changed["alarm"]) == (2, None)
    (old,) = await operator.alarms()
    assert (old["state"], old["ended"]) == ("cleared", None)
    operator.press(4.0, 4.0, 4.0)
    assert [each["revision"] for each in await operator.alarms()] == [2, 1]
    assert (await operator.ask("DELETE", MONITOR)).status_code == 204
    assert await operator.alarms(state="raised") == []
    problem(await operator.stand.get(MONITOR), 404)
    problem(await operator.ask("DELETE", MONITOR), 404)
    operator.press(1.0, 4.0, 4.0)
    assert len(await operator.alarms()) == 2


async def test_alarm_is_escalated_unless_it_is_acknowledged(operator: Operator) -> None:
    await operator.ask("PUT", MONITOR, BODY | {"escalate_after_s": 60.0})
    operator.press(4.0, 4.0)
    operator.stand.clock.turn(59.0)
    operator.advance()
    assert await operator.transitions(1) == ["raised"]
    operator.stand.clock.turn(1.0)
    operator.advance()
    operator.advance()
    assert await operator.transitions(1) == ["raised", "escalated"]
    operator.press(1.0, 4.0, 4.0)
    for _ in range(2):
        said = (await operator.ask("POST", "/api/v1/alarms/2/acknowledgement")).json()
        assert said["acknowledged_by"] == "shift"
    operator.stand.clock.turn(600.0)
    operator.advance()
    assert await operator.transitions(2) == ["raised", "acknowledged"]
    problem(await operator.ask("POST", "/api/v1/alarms/9/acknowledgement"), 404)


async def test_silenced_alarm_is_given_once_the_silence_ends(operator: Operator) -> None:
    await operator.ask("PUT", MONITOR, BODY | {"escalate_after_s": 0.0})
    silenced = await operator.ask("PUT", f"{MONITOR}/silence", {"seconds": 60})
    assert silenced.json()["silenced_until"] is not None
    operator.press(4.0, 4.0, 1.0, 4.0, 4.0)
    operator.advance()
    assert await operator.transitions(1) == ["raised", "cleared"]
    assert await operator.transitions(2) == ["raised"]
    operator.stand.clock.turn(60.0)
    operator.advance()
    assert await operator.transitions(2) == ["raised", "unsilenced", "escalated"]
    history = (await operator.stand.get("/api/v1/alarms/2")).json()["transitions"]
    assert [each["silenced"] for each in history] == [True, False, False]
    ended = await operator.ask("DELETE", f"{MONITOR}/silence")
    assert ended.json()["silenced_until"] is None
    problem(await operator.ask("PUT", "/api/v1/monitors/none/silence", {"seconds": 1}), 404)


async def test_changes_of_monitors_and_alarms_are_in_the_audit_log(operator: Operator) -> None:
    await operator.ask("PUT", MONITOR, BODY)
    await operator.ask("PUT", MONITOR, BODY)
    operator.press(4.0, 4.0)
    await operator.ask("POST", "/api/v1/alarms/1/acknowledgement")
    await operator.ask("POST", "/api/v1/alarms/1/acknowledgement")
    await operator.ask("PUT", f"{MONITOR}/silence", {"seconds": 60})
    await operator.ask("DELETE", MONITOR)
    with operator.stand.cloud.store.read() as connection:
        rows = connection.execute(select(audit_log).order_by(audit_log.c.number)).mappings().all()
    said = [(row["action"], row["actor"], row["target"]) for row in rows if row["actor"] == "shift"]
    assert said == [
        ("monitor defined", "shift", "squeeze"),
        ("alarm acknowledged", "shift", "1"),
        ("monitor silenced", "shift", "squeeze"),
        ("monitor deleted", "shift", "squeeze"),
    ]


async def test_receiver_is_given_what_comes_from_then_on(operator: Operator) -> None:
    store = operator.stand.cloud.store
    await operator.ask("PUT", MONITOR, BODY)
    operator.press(4.0, 4.0, 1.0, 1.0)
    store.write(lambda c: register_receiver(c, "webhook ops")).result(60)
    operator.press(4.0, 4.0, 1.0, 1.0)
    store.write(lambda c: register_receiver(c, "webhook ops")).result(60)
    with store.read() as connection:
        waiting = find_waiting(connection, "webhook ops")
    assert waiting is not None
    assert [row["number"] for row in waiting.transitions] == [4, 5]
    (said,) = (await operator.stand.get("/api/v1/receivers")).json()["items"]
    assert (said["delivered"], said["waiting"]) == (3, 2)
    for names, left in ((["webhook ops"], 1), (["alertmanager"], 0)):
        store.write(partial(forget_receivers, names=names)).result(60)
        found = (await operator.stand.get("/api/v1/receivers")).json()["items"]
        assert len(found) == left


async def test_cleared_alarms_are_removed_once_all_receivers_have_them(operator: Operator) -> None:
    store = operator.stand.cloud.store
    await operator.ask("PUT", MONITOR, BODY)
    operator.press(4.0, 4.0, 1.0, 1.0)
    store.write(lambda c: register_receiver(c, "webhook ops")).result(60)
    operator.press(4.0, 4.0, 1.0, 1.0)
    operator.press(4.0, 4.0)
    operator.stand.clock.turn(10.0)
    later = operator.stand.clock.now
    store.write(lambda c: remove_cleared(c, before=later)).result(60)
    assert [each["id"] for each in await operator.alarms()] == [3, 2]
    store.write(lambda c: note_delivered(c, "webhook ops", 6)).result(60)
    store.write(lambda c: remove_cleared(c, before=later)).result(60)
    assert [each["id"] for each in await operator.alarms()] == [3]
    operator.press(1.0, 4.0, 4.0)
    assert [each["id"] for each in await operator.alarms()] == [4, 3]


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"formula": "t09.capacitance > 2 F", "node": NODE}, 404),
        ({"formula": f"{CHANNEL} > 2 F", "node": "unknown"}, 404),
        ({"formula": f"{CHANNEL} > 2 F"}, 422),
        ({"formula": f"{CHANNEL} > 2 kPa", "node": NODE}, 422),
        ({"formula": f"{CHANNEL} >", "node": NODE}, 422),
        ({"formula": f"always {CHANNEL} > 2 F", "node": NODE}, 422),
        ({"formula": f"once[5s,2s] {CHANNEL} > 2 F", "node": NODE}, 422),
        ({"formula": f"once[0,30d] {CHANNEL} > 2 F", "node": NODE}, 422),
        ({"formula": "not " * 10_000 + f"{CHANNEL} > 2 F", "node": NODE}, 422),
        ({"formula": "true", "node": NODE}, 422),
        ({"formula": "h1.bioelectric > 2 V", "node": NODE}, 422),
        ({"formula": f"{CHANNEL} > 2 F", "node": NODE, "missing": True}, 422),
        ({"formula": f"{CHANNEL} > 2 F", "node": NODE, "raise_on": "impossible"}, 422),
        ({"formula": f"{CHANNEL} > 2 F", "node": NODE, "severity": "a b"}, 422),
        ({"formula": f"{CHANNEL} > 2 F", "node": NODE, "more": 1}, 422),
    ],
)
async def test_unusable_monitor_is_refused_and_changes_nothing(
    operator: Operator, body: dict[str, Any], status: int
) -> None:
    before = (await operator.ask("PUT", MONITOR, BODY)).json()
    problem(await operator.ask("PUT", MONITOR, body), status)
    assert (await operator.stand.get(MONITOR)).json() == before


async def test_names_are_checked_and_evaluation_is_taken(operator: Operator) -> None:
    for name in ("evaluation", "A", "a_b", "-a", "a" * 64):
        problem(await operator.ask("PUT", f"/api/v1/monitors/{name}", BODY), 422)
    assert (await operator.ask("PUT", "/api/v1/monitors/a-1", BODY)).status_code == 200


async def test_reader_may_not_change_anything(operator: Operator) -> None:
    await operator.ask("PUT", MONITOR, BODY)
    operator.token = operator.stand.token
    for method, path, body in (
        ("PUT", MONITOR, BODY),
        ("DELETE", MONITOR, None),
        ("PUT", f"{MONITOR}/silence", {"seconds": 1}),
        ("DELETE", f"{MONITOR}/silence", None),
        ("POST", "/api/v1/alarms/1/acknowledgement", None),
    ):
        problem(await operator.ask(method, path, body), 403)
