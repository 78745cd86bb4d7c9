"""Who looks at a skin: a WebSocket viewer that takes up where it broke off, and a page.

``python -m tests.support.skin_watcher PORT NODE FILE`` with a token in ``ESKIN_TOKEN`` looks until
it is ended. It appends a line to the file when a stream has begun (``open``), for each frame that
came (``frame BOOT SEQUENCE``), for frames that the cloud states as left out (``skipped NUMBER``,
``skipped some``), for each round of the page's questions that was answered (``page``), and for what
is wrong (``wrong``).
"""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import httpx
from websockets.exceptions import WebSocketException

from eskin.wire.frames import EncodedFrame
from eskin.wire.timestamp import SECOND, format_timestamp, parse_timestamp
from tests.support.processes import PLAIN
from tests.unit.cloud.frame_clients import dial

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.wire.messages import Position

_PAUSE_S: Final = 0.5
_ROUND_S: Final = 2.0
_WINDOW: Final = 10 * SECOND
_POINTS: Final = 100
_SERVER_ERROR: Final = 500


class Seen(NamedTuple):
    """What a watcher saw.

    Attributes:
        begun: Whether a stream has begun.
        frames: Of each frame that came, where it belongs.
        skipped: How many were stated as left out; ``None`` if a number was not known.
        pages: Rounds of the page's questions that were answered.
        wrong: What is wrong.
    """

    begun: bool
    frames: list[tuple[int, int]]
    skipped: int | None
    pages: int
    wrong: list[str]

    @classmethod
    def read(cls, file: Path) -> Seen:
        """Read the file of a watcher, which may not have begun."""
        lines = file.read_text().splitlines() if file.exists() else []
        frames = [line.split()[1:] for line in lines if line.startswith("frame ")]
        skipped = [line.split()[1] for line in lines if line.startswith("skipped ")]
        return cls(
            "open" in lines,
            [(int(boot), int(sequence)) for boot, sequence in frames],
            None if "some" in skipped else sum(map(int, skipped)),
            lines.count("page"),
            [line for line in lines if line.startswith("wrong ")],
        )


async def _view(port: int, token: str, node: str, note: Callable[[str], None]) -> None:
    """Take in frames, from the cursor on after each break."""
    cursor = ""
    while True:
        last: Position | None = None
        since: dict[str, Any] = {"cursor": cursor} if cursor else {}
        try:
            async with dial(port, token, node=(node,), max_size=None, **since) as connection:
                async for message in connection:
                    assert isinstance(message, bytes)
                    kind, *rest = cbor2.loads(message)
                    if kind == "layout":
                        continue
                    if not cursor:
                        note("open")
                    cursor = rest[0]
                    if kind == "frame":
                        place = EncodedFrame.decode(rest[3]).position
                        if place == last:
                            note(f"wrong frame {place} came twice")
                        last = place
                        note(f"frame {place.boot} {place.sequence}")
                    elif kind == "lagging" and rest[1] != 0:
                        note(f"skipped {'some' if rest[1] is None else rest[1]}")
        except (OSError, WebSocketException):
            await asyncio.sleep(_PAUSE_S)


async def _browse(port: int, token: str, node: str, note: Callable[[str], None]) -> None:
    """Ask what the page of a skin asks for."""
    headers, place = {"Authorization": f"Bearer {token}"}, f"/api/v1/nodes/{node}"
    base = f"http://127.0.0.1:{port}"
    async with httpx.AsyncClient(
        base_url=base, headers=headers, timeout=10, verify=PLAIN
    ) as client:
        while True:
            try:
                if await _ask_all(client, place, node, note):
                    note("page")
            except httpx.HTTPError:
                pass  # the cloud is away
            await asyncio.sleep(_ROUND_S)


async def _ask_all(
    client: httpx.AsyncClient, place: str, node: str, note: Callable[[str], None]
) -> bool:
    """Whether all was answered."""

    async def ask(path: str, accept: str = "*/*", **params: str) -> httpx.Response:
        answer = await client.get(path, params=params, headers={"Accept": accept})
        if answer.status_code == _SERVER_ERROR:
            note(f"wrong {path}: {answer.text!r}")
        return answer

    answers = [await ask(place), await ask(f"{place}/layout")]
    if answers[0].status_code == httpx.codes.OK and (seen := answers[0].json()["last_seen"]):
        end = parse_timestamp(seen)
        window = {"start": format_timestamp(end - _WINDOW), "end": format_timestamp(end)}
        window["points"] = str(_POINTS)
        answers.append(await ask(f"{place}/frames", "application/cbor-seq", **window))
        answers.append(await ask("/api/v1/contacts", node=node, **window))
    return all(answer.status_code == httpx.codes.OK for answer in answers)


async def _look(port: int, token: str, node: str, note: Callable[[str], None]) -> None:
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(_view(port, token, node, note))
        tasks.create_task(_browse(port, token, node, note))


def main(arguments: Sequence[str]) -> None:
    """Look until the process is ended."""
    port, node, path = arguments
    with Path(path).open("a", buffering=1) as file:
        asyncio.run(
            _look(int(port), os.environ["ESKIN_TOKEN"], node, lambda line: print(line, file=file))
        )


if __name__ == "__main__":
    main(sys.argv[1:])
