"""Commands: numbered, signed, given in order, answered once; desired and reported state."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.commands.desired_state import is_settled, merge_desired_state
from eskin_cloud.commands.issue import MOST_WAITING, Order, issue
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire.messages import CommandName
from eskin.wire.timestamp import SECOND, format_timestamp
from tests.unit.cloud.clouds import Stand, batch, problem, put
from tests.unit.cloud.messages import NODE, status, stretch
from tests.unit.cloud.orders import SOON_S, fetch, opened, order, result, waiting_gateway

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin.wire.messages.command import Arguments, State
    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio

RATE = {"name": "set", "arguments": {"rate": 500}}


@pytest.fixture(autouse=True)
def seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who waits for a command looks for none by itself."""
    monkeypatch.setattr("eskin_cloud.api.deliveries._LOOK_S", 2 * SOON_S)


@pytest.fixture
def known(stand: Stand) -> Stand:
    """A cloud that has heard of the node."""
    put(stand.cloud.store, status(0))
    return stand


async def get(stand: Stand, path: str) -> Any:
    answer = await stand.get(f"/api/v1/nodes/{NODE}/{path}")
    assert answer.status_code == 200, answer.text
    return answer.json()


async def issued(stand: Stand, body: Any = RATE) -> int:
    answer = await order(stand, body)
    assert answer.status_code == 202, answer.text
    number = answer.json()["id"]
    assert isinstance(number, int)
    return number


async def test_command_is_numbered_and_signed_for_its_node(
    known: Stand, identities: Identities
) -> None:
    answer = await order(known, RATE | {"expires_s": 60})
    number = answer.json()["id"]
    now = known.clock()
    assert answer.status_code == 202
    assert answer.headers["location"] == f"/api/v1/nodes/{NODE}/commands/{number}"
    assert answer.json() == await get(known, f"commands/{number}")
    assert answer.json() == {
        "id": now // SECOND,
        "node": NODE,
        "name": "set",
        "arguments": {"rate": 500.0},
        "state": "pending",
        "reason": None,
        "issued": format_timestamp(now),
        "expires": format_timestamp(now + 60 * SECOND),
        "delivered": None,
        "answered": None,
    }
    ((node, given, signed),) = cbor2.loads((await fetch(known)).content)["give"]
    assert (node, given) == (NODE, number)
    command = opened(identities, signed)
    assert (command.id, command.node, command.arguments) == (number, NODE, {"rate": 500.0})
    assert (command.issued, command.expires) == (now, now + 60 * SECOND)


async def test_commands_are_given_one_by_one_in_their_order(known: Stand) -> None:
    first, second = await issued(known), await issued(known)
    assert second == first + 1
    given = cbor2.loads((await fetch(known)).content)
    assert [(node, number) for node, number, _ in given["give"]] == [(NODE, first)]
    assert cbor2.loads((await fetch(known, [[NODE, first, False]])).content) == {
        "give": [],
        "drop": [],
        "alarms": [],
    }
    put(known.cloud.store, result(1, first))
    changes = cbor2.loads((await fetch(known, [[NODE, first, True]])).content)
    assert [(node, number) for node, number, _ in changes["give"]] == [(NODE, second)]
    assert changes["drop"] == [[NODE, first]]


async def test_waiting_gateway_is_woken_by_a_command_and_by_its_answer(known: Stand) -> None:
    waiting = await waiting_gateway(known)
    number = await issued(known)
    given = cbor2.loads((await asyncio.wait_for(waiting, SOON_S)).content)
    assert [(n, i) for n, i, _ in given["give"]] == [(NODE, number)]
    waiting = await waiting_gateway(known, [NODE, number, True])
    await known.ingest(batch(result(1, number)))
    changes = cbor2.loads((await asyncio.wait_for(waiting, SOON_S)).content)
    assert changes == {"give": [], "drop": [[NODE, number]], "alarms": []}


async def test_closing_cloud_lets_no_caller_wait(known: Stand) -> None:
    waiting = await waiting_gateway(known)
    known.cloud.notifier.close()
    assert (await asyncio.wait_for(waiting, SOON_S)).status_code == 200


async def test_state_of_a_command_follows_its_way(known: Stand) -> None:
    number = await issued(known)
    await fetch(known, [[NODE, number, False]])
    assert (await get(known, f"commands/{number}"))["state"] == "pending"
    await fetch(known, [[NODE, number, True]])
    delivered = await get(known, f"commands/{number}")
    assert (delivered["state"], delivered["delivered"]) == (
        "delivered",
        format_timestamp(known.clock()),
    )
    known.clock.turn(5)
    await fetch(known, [[NODE, number, True]])
    assert (await get(known, f"commands/{number}"))["delivered"] == delivered["delivered"]
    put(known.cloud.store, result(1, number, reason="rate: too high"))
    refused = await get(known, f"commands/{number}")
    assert (refused["state"], refused["reason"]) == ("refused", "rate: too high")
    assert refused["answered"]["lo"] < refused["answered"]["hi"]
    # Said again at the node's next start: nothing changes, and no second event states it.
    put(known.cloud.store, result(0, number, boot=2))
    assert await get(known, f"commands/{number}") == refused
    events = (await known.get("/api/v1/events", kind="command")).json()["items"]
    assert [event["detail"] for event in events] == ["set rate 500: refused: rate: too high"]


async def test_unanswered_command_expires_and_lets_the_next_pass(known: Stand) -> None:
    first = await issued(known, RATE | {"expires_s": 1})
    second = await issued(known)
    known.clock.turn(1)
    expired = await get(known, f"commands/{first}")
    assert (expired["state"], expired["reason"]) == ("expired", "no answer came in time")
    changes = cbor2.loads((await fetch(known, [[NODE, first, True]])).content)
    assert ([i for _, i, _ in changes["give"]], changes["drop"]) == ([second], [[NODE, first]])
    # It had been done in time; only the answer was late.
    put(known.cloud.store, result(1, first))
    assert (await get(known, f"commands/{first}"))["state"] == "done"


async def test_desired_and_reported_state_are_kept_apart(known: Stand) -> None:
    nothing = await get(known, "state")
    assert (nothing["desired"], nothing["reported"], nothing["settled"]) == ({}, None, True)
    first = await issued(known)
    second = await issued(
        known,
        {"name": "set", "arguments": {"threshold": 1e-13, "channel": "t01.capacitance"}},
    )
    stated: State = {"t01": {"rate": 500.0, "gain": 1.0}}
    put(known.cloud.store, result(1, first, state=stated))
    state = await get(known, "state")
    assert state["desired"] == {"*": {"rate": 500.0}, "t01.capacitance": {"threshold": 1e-13}}
    assert (state["desired_by"], state["reported_by"]) == (second, first)
    assert (state["reported"], state["settled"]) == (stated, False)
    put(
        known.cloud.store,
        result(2, second, state=stated | {"t01.capacitance": {"threshold": 1e-13}}),
        result(1, first, boot=0, state={"t01": {"rate": 7.0}}),
    )
    assert (await get(known, "state"))["settled"] is True
    await issued(known, {"name": "reset"})
    assert (await get(known, "state"))["desired"] == {}


async def test_numbers_stay_above_those_of_a_lost_store(known: Stand) -> None:
    numbers = [await issued(known) for _ in range(3)]
    assert numbers == list(range(numbers[0], numbers[0] + 3))
    known.clock.turn(100)
    assert await issued(known) == known.clock() // SECOND


async def test_too_many_waiting_commands_are_refused(known: Stand) -> None:
    wanted = Order(NODE, CommandName.RESET, {}, SECOND)

    def fill(connection: Connection) -> None:
        for _ in range(MOST_WAITING):
            issue(connection, wanted, sign=lambda _: b"", now=known.clock())

    known.cloud.store.write(fill).result(120)
    assert "wait for fingertip already" in problem(await order(known, RATE), 409)
    known.clock.turn(1)
    await issued(known)


BAD_ORDERS: tuple[tuple[Any, str], ...] = (
    ({"name": "explode"}, "name: 'explode' is not allowed: Input should be 'calibrate', 'set'"),
    ({}, "name: is missing"),
    ({"arguments": {}}, "name: is missing; add it to the body"),
    ([], "request: [] is not allowed"),
    ({"name": "set"}, "arguments is {}; allowed: set takes at least one of"),
    ({"name": "set", "arguments": {"rate": 2e6}}, "arguments.rate: 2000000.0 is not allowed"),
    ({"name": "set", "arguments": {"rate": 2e6}}, "less than or equal to 1000000"),
    ({"name": "set", "arguments": {"rate": "5"}}, "arguments.rate: '5' is not allowed"),
    ({"name": "set", "arguments": {"rate": True}}, "arguments.rate: True is not allowed"),
    ({"name": "set", "arguments": {"smoothing": -1}}, "arguments.smoothing: -1 is not allowed"),
    ({"name": "set", "arguments": {"mode": "x"}}, "'samples', 'peaks' or 'adaptive'"),
    ({"name": "set", "arguments": {"volume": 1}}, "arguments.volume: no such parameter"),
    ({"name": "set", "arguments": {"threshold": 1}}, "channel is missing; allowed:"),
    (
        {"name": "set", "arguments": {"threshold": 1, "channel": "t09.capacitance"}},
        "channel is 't09.capacitance'; allowed: what fingertip has: t01.capacitance",
    ),
    ({"name": "calibrate", "arguments": {"taxel": "t09"}}, "allowed: what fingertip has: t01"),
    ({"name": "reset", "arguments": {"gain": 1}}, "gain is 1.0; allowed: reset takes nothing"),
    (RATE | {"expires_s": 0}, "expires_s: 0 is not allowed"),
    (RATE | {"expires_s": 1e9}, "less than or equal to 2592000"),
)


async def test_invalid_order_is_refused_with_field_value_and_what_is_allowed(
    known: Stand, subtests: pytest.Subtests
) -> None:
    put(known.cloud.store, stretch(1))
    for body, says in BAD_ORDERS:
        with subtests.test(str(body)):
            assert says in problem(await order(known, body), 422)
    assert cbor2.loads((await fetch(known)).content) == {"give": [], "drop": [], "alarms": []}


async def test_body_that_ends_early_is_refused_by_its_position(known: Stand) -> None:
    kind = {"Content-Type": "application/json"}
    answer = await order(known, None, content=b'{"name": "set"', headers=kind)
    assert problem(answer, 422).startswith("body: no JSON from position 14 on")


@pytest.mark.parametrize("kind", ["application/x-www-form-urlencoded", None])
async def test_body_of_another_type_is_refused_by_its_header(
    known: Stand, kind: str | None
) -> None:
    headers = {} if kind is None else {"Content-Type": kind}
    said = problem(await order(known, None, content=b'{"name": "reset"}', headers=headers), 422)
    assert said.startswith("Content-Type")
    assert "application/json" in said
    assert ("missing" if kind is None else kind) in said
    assert "reset" not in said


async def test_only_operators_command_and_only_from_our_own_pages(known: Stand) -> None:
    assert "lacks the scope operate" in problem(await order(known, RATE, token=known.token), 403)
    problem(await order(known, RATE, token=""), 401)
    foreign = {"Sec-Fetch-Site": "cross-site"}
    assert "another site" in problem(await order(known, RATE, headers=foreign), 403)


async def test_unknown_places_are_named(known: Stand) -> None:
    problem(await order(known, RATE, node="unknown"), 404)
    problem(await known.get("/api/v1/nodes/unknown/state"), 404)
    problem(await known.get("/api/v1/nodes/unknown/commands/1"), 404)
    problem(await known.get(f"/api/v1/nodes/{NODE}/commands/1"), 404)
    problem(await known.get(f"/api/v1/nodes/{NODE}/commands/0"), 422)


INVALID_REQUESTS: tuple[Any, ...] = (
    [],
    {"held": []},
    {"held": [], "wait_s": 61.0, "published": None},
    {"held": [], "wait_s": 1, "published": None},
    {"held": [["n", 1]], "wait_s": 1.0, "published": None},
    {"held": [["n", 0, True]], "wait_s": 1.0, "published": None},
    {"held": [["n", 1, 1]], "wait_s": 1.0, "published": None},
    {"held": [[1, 1, True]], "wait_s": 1.0, "published": None},
    {"held": [], "wait_s": 1.0},
    {"held": [], "wait_s": 1.0, "published": -1},
    {"held": [], "wait_s": 1.0, "published": "1"},
)


async def test_invalid_request_of_a_gateway_is_refused(
    known: Stand, subtests: pytest.Subtests
) -> None:
    for body in (b"", b"\xff", *map(cbor2.dumps, INVALID_REQUESTS)):
        with subtests.test(body.hex()):
            assert "docs/eskin.cddl" in problem(await fetch(known, body=body), 422)


async def test_foreign_gateways_are_given_no_commands(known: Stand) -> None:
    await issued(known)
    known.gateway = None
    problem(await fetch(known), 403)


PLACES = st.sampled_from(["t01", "t02", None])
SETS = st.lists(st.tuples(PLACES, st.sampled_from(["rate", "gain"]), st.sampled_from([1.0, 2.0])))


@given(orders=SETS)
def test_node_that_does_all_that_is_desired_is_settled(
    orders: list[tuple[str | None, str, float]],
) -> None:
    desired_state: State = {}
    node: State = {"t01": {"rate": 7.0, "gain": 7.0}, "t02": {"rate": 7.0, "gain": 7.0}}
    for taxel, field, value in orders:
        arguments: Arguments = {field: value} | ({} if taxel is None else {"taxel": taxel})
        desired_state = merge_desired_state(desired_state, CommandName.SET, arguments)
        for place in node if taxel is None else [taxel]:
            node[place][field] = value
        assert is_settled(desired_state, node)
        other = {name: found | {field: 9.0} for name, found in node.items()}
        assert not is_settled(desired_state, other)
    assert is_settled(desired_state, None) is (not orders)
    assert merge_desired_state(desired_state, CommandName.RESET, {}) == {}
