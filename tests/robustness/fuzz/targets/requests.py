"""Requests of people: any path, parameters, headers and body, over the whole application."""

from __future__ import annotations

import json
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.people import People
from tests.robustness.fuzz.target import Target
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, gap, peak, status, stretch

if TYPE_CHECKING:
    from pathlib import Path

_SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
_ASKED = (
    "GET /api/v1/nodes",
    f"GET /api/v1/nodes/{NODE}/channels",
    f"GET /api/v1/nodes/{NODE}/state",
    f"GET /api/v1/nodes/{NODE}/commands/1",
    f"GET {_SERIES}?start={START}&end={START + 10**9}&points=100",
    f"GET {_SERIES}?start=2027-01-15T08:00:00Z&points=2\nAccept: text/csv;q=0.5, */*;q=0.1",
    f"GET {_SERIES}\nAccept: application/vnd.apache.parquet",
    f"GET {_SERIES}/threshold?above=1.5",
    f"GET /api/v1/events?node={NODE}&channel={CHANNEL}&kind=peak&verdict=certain&limit=1&order=asc",
    "GET /api/v1/events?cursor=MTgwMDAwMDAwMDAwMDAwMDAwMAox",
    f"GET /api/v1/live?channel={NODE}/{CHANNEL}&points=2\nLast-Event-ID: 1",
    "GET /api/v1/audit-log?limit=3",
    "GET /api/v1/tokens",
    "DELETE /api/v1/tokens/1",
    "GET /openapi.json",
    "GET /healthz\nHost: cloud\nOrigin: http://cloud\nSec-Fetch-Site: same-origin",
    "POST /logout\nOrigin: http://cloud",
    "GET /assets/index.js",
    "GET /metrics",
    "GET /login?code=x",
    "GET /nodes/fingertip",
    "POST /login\nContent-Type: application/x-www-form-urlencoded\n\ntoken=x",
)
_COMMANDS = ({"rate": 500, "taxel": "t01"}, {"threshold": 1e-12, "channel": CHANNEL})
_BODIES = (
    *(
        (f"nodes/{NODE}/commands", {"name": "set", "arguments": given, "expires_s": 60})
        for given in _COMMANDS
    ),
    (f"nodes/{NODE}/commands", {"name": "reset"}),
    ("tokens", {"name": "lab", "scopes": ["read"], "days": 30}),
)

_LONGEST: Final = 4096
"""Bytes of an input."""


def make(folder: Path) -> Target:
    """The input is ``METHOD target``, header lines, an empty line, a body; none is answered by 5xx.

    An answer is no traceback; a refusal is problem details; the headers for browsers are there.
    """
    stack = ExitStack()
    people = People(folder, stack)
    put(people.store, status(0), stretch(1, [1.0] * 50, [2.0] * 50), peak(2), gap(3))

    def check(data: bytes) -> None:
        head, _, body = data.partition(b"\n\n")
        first, *lines = head.split(b"\n")
        method, _, target = first.partition(b" ")
        headers = [
            (name.strip().lower(), value.strip())
            for name, found, value in (line.partition(b":") for line in lines)
            if found
        ]
        people.ask(method.decode("latin-1"), target, headers, body)

    posted = [
        f"POST /api/v1/{path}\nContent-Type: application/json\n\n{json.dumps(body)}"
        for path, body in _BODIES
    ]
    seeds = tuple(seed.encode() for seed in (*_ASKED, *posted))
    return Target(seeds, mutate_text, check, stack, _LONGEST)
