"""A reader of the live stream of several clouds, and what it must have seen at the end."""

from __future__ import annotations

import json
import threading
from typing import TYPE_CHECKING, Self

import httpx
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.tables import sequences
from sqlalchemy import func, select

from tests.support.processes import wait_until

if TYPE_CHECKING:
    from types import TracebackType

    from eskin_cloud.store import Store

    from tests.support.stacks import RealStack


class LiveViewer(threading.Thread):
    """Reads the live stream of a cloud, and goes on at the next where it breaks off.

    A client that is slow is sent fewer and wider hulls, so samples are counted and not frames. What
    states no new id may come again after a break, so it counts once a new id follows.

    It reads from the start of its block to the end of it, or until it has seen what it must.

    Args:
        stack: With the clouds.
        token: A reader's.
        cloud: Where it begins.

    Attributes:
        samples: How many the hulls that came are of.
        breaks: How often the stream broke off.
        may_resume: Whether it goes on after a break at once.
    """

    def __init__(self, stack: RealStack, token: str, *, cloud: int = 0) -> None:
        super().__init__(daemon=True)
        self.samples = 0
        self.breaks = 0
        self.ended = threading.Event()
        self.may_resume = threading.Event()
        self.may_resume.set()
        self._stack = stack
        self._token = token
        self._cloud = cloud
        self._id: str | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.ended.set()
        self.may_resume.set()

    @property
    def connected(self) -> bool:
        """Whether it has ever been connected: it misses nothing from then on."""
        return self._id is not None

    def run(self) -> None:
        cloud = self._cloud
        while not self.ended.is_set():
            try:
                self._read(cloud)
            except httpx.HTTPError:
                self.breaks += 1
                self.may_resume.wait()
                cloud = (cloud + 1) % len(self._stack.clouds)

    def _read(self, cloud: int) -> None:
        headers = {} if self._id is None else {"Last-Event-ID": self._id}
        with (
            self._stack.operator(cloud, self._token) as client,
            client.stream("GET", "/live", headers=headers) as answer,
        ):
            answer.raise_for_status()
            kind, name, pending = "", self._id, 0
            for line in answer.iter_lines():
                field, _, value = line.partition(": ")
                if field == "event":
                    kind = value
                elif field == "id":
                    name = value
                elif field == "data" and kind == "frame":
                    patches = json.loads(value)["patches"]
                    pending += sum(each["n"] * len(each["lo"]) for each in patches)
                elif not line and name != self._id:
                    self.samples += pending
                    self._id, pending = name, 0
                if self.ended.is_set():
                    return


def count_stored(store: Store) -> int:
    """How many messages are stored.

    Raises:
        StoreError: The store cannot be read.
    """
    with store.read() as connection:
        counted = select(func.coalesce(func.sum(sequences.c.last - sequences.c.first + 1), 0))
        return int(connection.execute(counted).scalar_one())


def require_each_once(store: Store, *viewers: LiveViewer) -> None:
    """Check that each message of each node's one boot is stored once, and each sample seen once."""
    with store.read() as connection:
        spans = connection.execute(select(sequences)).all()
        numbers = connection.execute(select(frames.c.node, frames.c.sequence)).all()
        count = connection.execute(select(func.sum(frames.c.samples))).scalar_one()
    assert spans
    assert len({row.node for row in spans}) == len(spans), "no number is missing"
    assert {row.first for row in spans} == {0}
    assert len(set(numbers)) == len(numbers), "no frame is there twice"
    for viewer in viewers:
        wait_until(lambda: viewer.samples >= count, f"each viewer sees all {count} samples")  # noqa: B023
        viewer.ended.set()
        assert viewer.samples == count, f"{viewer.samples} instead of {count} samples were seen"
