"""Odd texts in bodies, paths, queries and headers are no fault of ours."""

from __future__ import annotations

import asyncio
from datetime import timedelta
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import pytest
from eskin_cloud.access import Scope, create_token

from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, status, stretch

if TYPE_CHECKING:
    import httpx

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

VALUES: Final = (
    r'"\ud800"', r'"\udfff\ud800"', r'"\u0000"', '""', '" "', '"' + "a" * 5000 + '"', "null",
    "true", "[]", "{}", r'{"\ud800": 1}', "[[[[", "NaN", "-0", "1e999", "1e-400", "9" * 400,
)  # fmt: skip
BODIES: Final = (
    ("tokens", '{"name": %s, "scopes": ["read"]}'),
    ("tokens", '{"name": "a", "scopes": [%s]}'),
    ("tokens", '{"name": "a", "scopes": ["read"], "days": %s}'),
    ("tokens", '{"name": "a", "scopes": ["read"], %s: 1}'),
    (f"nodes/{NODE}/commands", '{"name": %s}'),
    (f"nodes/{NODE}/commands", '{"name": "calibrate", "arguments": {"taxel": %s}}'),
    (f"nodes/{NODE}/commands", '{"name": "set", "arguments": {"rate": %s}}'),
    (f"nodes/{NODE}/commands", '{"name": "set", "arguments": {"threshold": 1, "channel": %s}}'),
    (f"nodes/{NODE}/commands", '{"name": "calibrate", "expires_s": %s}'),
)
RAW: Final = (b"\xff\xfe", b"\xed\xa0\x80", b"", b"[" * 20_000, b'{"a":' * 5000, b"\x00")
TEXTS: Final = (
    "%ED%A0%80", "%00", "%FF", "%C0%80", "%F4%90%80%80", "%EF%BF%BF", "%0A", "%D9%A1", "a%2Fb", "=",
    "NaN", "inf", "1e999", "-1", "1_0", "0x1p3", "9" * 400, "a" * 3000, "9999999999999999999",
    "-9223372036854775809", "2027-13-01T00:00:00Z", "2027-01-01T00:00:00.0000000001Z",
)  # fmt: skip
PATHS: Final = (
    "nodes/%s/commands/1", "nodes/%s/state", f"nodes/{NODE}/commands/%s", "nodes?%s=1",
    "series/%s/x", f"series/{NODE}/%s", f"series/{NODE}/{CHANNEL}?start=%s",
    f"series/{NODE}/{CHANNEL}?points=%s", f"series/{NODE}/{CHANNEL}/threshold?above=%s",
    f"series/{NODE}/{CHANNEL}/threshold?above=1&cursor=%s",
    f"series/{NODE}/{CHANNEL}/time?above=%s", "events?node=%s", "events?cursor=%s",
    "events?channel=%s", "export?channel=%s", f"export?channel={NODE}/{CHANNEL}&cursor=%s",
    "audit-log?cursor=%s", "subjects/%s/export", "live?node=%s", "live?channel=%s", "%s",
)  # fmt: skip
HEADERS: Final = (
    b"authorization", b"cookie", b"accept", b"origin", b"sec-fetch-site", b"range", b"if-range",
    b"content-length", b"host",
)  # fmt: skip
HEADER_VALUES: Final = (
    b"\xff", b"Bearer \xff", b"bytes=-", b"a-b", b"eskin_session=\xff\xfe", b"*/*;q=nan", b"",
    b"http://[::1", b"9" * 400,
)  # fmt: skip


COMMANDS: Final = f"nodes/{NODE}/commands"
GOT: Final = ("../../", f"series/{NODE}/{CHANNEL}")


def is_answered_well(answer: httpx.Response) -> bool:
    """Whether it is no fault of ours, and problem details if it is a refusal."""
    problem = answer.headers.get("content-type", "").startswith("application/problem+json")
    return answer.status_code < 500 and (answer.status_code < 400 or problem)


@pytest.mark.nightly
async def test_odd_requests_are_no_fault_of_ours(stand: Stand) -> None:
    stand.cloud.dashboard.mkdir()
    (stand.cloud.dashboard / "index.html").write_text("<p>here</p>")
    put(stand.cloud.store, status(0), stretch(1))
    hour = timedelta(hours=1)
    token = create_token(stand.cloud.store, scopes=list(Scope), name="all", lifetime=hour)
    broken: list[tuple[str, int]] = []

    async def ask(method: str, path: str, **options: Any) -> None:
        try:
            async with asyncio.timeout(5):
                answer = await client.request(method, path, **options)
        except TimeoutError:
            assert "/live" in path  # what is streamed does not end
        else:
            if not is_answered_well(answer):
                broken.append((f"{method} {path[:80]} {str(options)[:120]}", answer.status_code))

    asked: list[tuple[str, str, dict[str, Any]]] = [
        *(
            ("POST", path, {"content": (body % v).encode()})
            for (path, body), v in product(BODIES, VALUES)
        ),
        *(("POST", path, {"content": raw}) for path, raw in product(("tokens", COMMANDS), RAW)),
        *(("GET", path.replace("%s", text), {}) for path, text in product(PATHS, TEXTS)),
        *(
            ("DELETE", f"{path}/{text}", {})
            for path, text in product(("tokens", "sessions"), TEXTS)
        ),
        *(
            ("GET", path, {"headers": [one]})
            for one in product(HEADERS, HEADER_VALUES)
            for path in GOT
        ),
    ]
    async with stand.client(token=token) as client:
        for method, path, options in asked:
            sent = {"headers": {"content-type": "application/json"}, **options}
            await ask(method, f"/api/v1/{path}", **sent)
    assert broken == []
