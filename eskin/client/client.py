"""The client."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import httpx
import pyarrow as pa
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from eskin.client.frames import Frames
from eskin.client.http import API, HttpClient
from eskin.client.queries import Queries, written_instants
from eskin.client.tubes import joined, read_tubes
from eskin.errors import QueryError
from eskin.identity import client_context
from eskin.runtime.net import is_loopback

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from types import TracebackType

    from eskin.client.queries import Instant
    from eskin.gestures import Kind
    from eskin.tube import Tube

_ARROW: Final = "application/vnd.apache.arrow.stream"
_TIMEOUT_S: Final = 60.0


def connect(
    url: str,
    token: str,
    *,
    root: Path | None = None,
    page: int = 1_000_000,
    retry_s: float = 0.5,
    transport: httpx.BaseTransport | None = None,
) -> Client:
    """Connect to a cloud.

    Args:
        url: Such as ``https://cloud:8080``; ``http`` on this machine alone.
        token: A token with the scope ``read``.
        root: PEM file of the CA that certified the cloud; else the system's CAs are trusted.
        page: Samples in one request of a long read.
        retry_s: Seconds before a request that failed in passing is repeated for the first time.
        transport: Carries requests in place of the network.

    Raises:
        QueryError: The address would carry the token in the clear.
        IdentityError: ``root`` cannot be read.
    """
    address = httpx.URL(url)
    if address.scheme != "https" and not is_loopback(address.host):
        raise QueryError("url", f"{url!r} would carry the token in the clear; use https")
    http = httpx.Client(
        base_url=address,
        headers={"Authorization": f"Bearer {token}"},
        verify=True if root is None else client_context(root),
        timeout=_TIMEOUT_S,
        transport=transport,
    )
    return Client(HttpClient(http, retry_s=retry_s), page=page)


class Client(Queries):
    """What a cloud knows, as tubes. A context manager; made by `connect`.

    Args:
        pages: Asks the cloud.
        page: Samples in one request of a long read.
    """

    def __init__(self, pages: HttpClient, *, page: int) -> None:
        super().__init__(pages)
        self._page = page

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._pages.close()

    def nodes(self) -> list[dict[str, Any]]:
        """All nodes, as ``GET /nodes`` lists them.

        Raises:
            CloudError: The cloud refused, or did not answer.
        """
        return list(self._pages.items(f"{API}/nodes"))

    def channels(self, node: str) -> list[dict[str, Any]]:
        """A node's channels, as ``GET /nodes/{node}/channels`` lists them.

        Raises:
            CloudError: As `nodes`.
        """
        return list(self._pages.items(f"{API}/nodes/{node}/channels"))

    def layout(self, node: str, layout: str | None = None) -> dict[str, Any]:
        """What a node's frames are read by: its patches, where their taxels are, and neighbours.

        Args:
            node: Such as ``hand``.
            layout: Hash of a layout, such as `Frames.layout`; else the latest one is read.

        Raises:
            CloudError: As `nodes`.
        """
        path = f"{API}/nodes/{node}/" + ("layout" if layout is None else f"layouts/{layout}")
        found: dict[str, Any] = self._pages.get(path, accept="application/json").json()
        return found

    def frames(
        self,
        node: str,
        *,
        start: Instant | None = None,
        end: Instant | None = None,
        points: int = 100,
        quantity: str | None = None,
        own: bool = False,
    ) -> Frames:
        """Pictures of a node's skin; a window that is left out is the last minute of data.

        A picture lasts 1.5 sampling periods at least, so a short window has fewer than ``points``.

        Args:
            node: Such as ``hand``.
            start: Included.
            end: Excluded.
            points: Most pictures.
            quantity: Else pressure, or that of the layout's first patch where it has none.
            own: Whether only the node's own taxels are read, of a skin that several nodes share.

        Raises:
            QueryError: An instant without a time zone.
            CloudError: As `nodes`; also where the window has too many frames for one answer.
        """
        params: dict[str, Any] = written_instants(start=start, end=end) | {"points": points}
        params |= {} if quantity is None else {"quantity": quantity}
        params |= {"own": "true"} if own else {}
        answer = self._pages.get(f"{API}/nodes/{node}/frames", params, accept=_ARROW)
        return Frames.read(answer.content)

    def gestures(
        self,
        node: str,
        *,
        kind: Kind | None = None,
        verdict: Literal["possible", "certain"] | None = None,
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> list[dict[str, Any]]:
        """Gestures on a node's skin that are certain or possible, in the order of their ends.

        A window that is left out is the last minute of data; the record begins and ends with it.

        Args:
            node: Such as ``hand``.
            kind: Only this one.
            verdict: Only those with this one.
            start: Included.
            end: Excluded.

        Raises:
            QueryError: An instant without a time zone.
            CloudError: As `nodes`; also where the window is too long, or the node samples no whole
                skin with contacts on one grid.
        """
        params: dict[str, Any] = written_instants(start=start, end=end)
        params |= {} if kind is None else {"kind": kind}
        params |= {} if verdict is None else {"verdict": verdict}
        return list(self._pages.items(f"{API}/nodes/{node}/gestures", params))

    def series(
        self,
        node: str,
        channel: str,
        *,
        start: Instant | None = None,
        end: Instant | None = None,
        progress: bool | None = None,
    ) -> list[Tube]:
        """All samples of a channel in a window, a tube for each stretch without a gap.

        Args:
            node: Such as ``fingertip``.
            channel: Such as ``t01.capacitance``.
            start: Included; else from the first sample on.
            end: Excluded; else up to the last sample.
            progress: Whether a bar is shown; else where it takes more than one request, on a
                terminal or in a notebook.

        Raises:
            QueryError: An instant without a time zone.
            CloudError: As `nodes`.
        """
        with _bar(f"{node}/{channel}", wanted=progress) as advance:
            return list(joined(self._pieces(node, channel, start, end, advance)))

    def pieces(
        self,
        node: str,
        channel: str,
        *,
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> Iterator[Tube]:
        """As `series`, but frame by frame while they come: for what does not fit into memory.

        Raises:
            QueryError: As `series`.
            CloudError: As `nodes`.
        """
        return self._pieces(node, channel, start, end, lambda *_: None)

    def _pieces(
        self,
        node: str,
        channel: str,
        start: Instant | None,
        end: Instant | None,
        advance: Callable[[int, int], None],
    ) -> Iterator[Tube]:
        params: dict[str, Any] = written_instants(start=start, end=end)
        params |= {"channel": f"{node}/{channel}", "limit": self._page}
        total = 0
        for answer in self._pages.following(f"{API}/export", params, accept=_ARROW):
            total = int(answer.headers.get("Eskin-Samples", total))
            with pa.ipc.open_stream(answer.content) as reader:
                table = reader.read_all()
            advance(table.num_rows, total)
            yield from read_tubes(table)


@contextmanager
def _bar(name: str, *, wanted: bool | None) -> Iterator[Callable[[int, int], None]]:
    """A progress bar that appears with the first page that is not the last."""
    console = Console(stderr=True)
    shown = (console.is_terminal or console.is_jupyter) if wanted is None else wanted
    columns = TextColumn(name), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    bar = Progress(*columns, console=console, disable=not shown)
    task = bar.add_task(name, total=None)

    def advance(count: int, total: int) -> None:
        bar.update(task, advance=count, total=total)
        if wanted or not bar.finished:
            bar.start()

    try:
        yield advance
    finally:
        bar.stop()
