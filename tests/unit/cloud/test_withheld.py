"""What the cloud cannot use, and what may identify a person, is kept by its size alone."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import cbor2
import pytest
from eskin_cloud.store.schema.tables import dead_letters
from sqlalchemy import select

from eskin.wire.messages import Kind
from tests.unit.cloud.messages import stretch
from tests.unit.cloud.sealing import CHANNEL, NODE, declared, pulse, remains

if TYPE_CHECKING:
    from pathlib import Path

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
SECRET: Final = b"SECRET-HEART"


def spoiled(channel: str, more: bytes = b"") -> bytes:
    """A frame with a field that no frame has."""
    fields = cbor2.loads(pulse(50, channel=channel).encode())
    return cbor2.dumps(fields | {99: SECRET + more}, canonical=True)


@pytest.mark.parametrize(
    "item",
    [
        [NODE, spoiled(CHANNEL)],
        [NODE, spoiled(CHANNEL, bytes(70_000))],
        [NODE, spoiled(CHANNEL)[:-3]],
        [NODE, SECRET],
        [NODE, cbor2.dumps(SECRET.decode())],
        [NODE, cbor2.dumps({1: SECRET.decode(), 4: CHANNEL})],
        [NODE, cbor2.dumps({1: int(Kind.STATUS), 2: SECRET.decode()})],
        ["No Such Name", pulse(1).encode() + SECRET],
        [NODE, spoiled(CHANNEL), 1],
        [SECRET],
        SECRET,
    ],
)
async def test_what_cannot_be_read_and_may_tell_of_a_person_is_kept_nowhere(
    stand: Stand, tmp_path: Path, caplog: pytest.LogCaptureFixture, item: Any
) -> None:
    await stand.ingest(cbor2.dumps([[NODE, declared().encode()]]))
    answer = await stand.ingest(cbor2.dumps([item]))
    (stated,) = answer.json()["items"]
    assert stated["result"] == "rejected"
    with stand.cloud.store.read() as connection:
        (letter,) = connection.execute(select(dead_letters)).mappings().all()
    assert letter["data"] == b""
    assert "are not kept, as they may be biometric" in letter["reason"]
    assert SECRET not in remains(tmp_path)
    assert SECRET.decode() not in caplog.text + answer.text


async def test_frame_without_a_subject_that_does_not_fit_its_layout_is_kept(stand: Stand) -> None:
    body = replace(stretch(50), page=1).encode()
    await stand.ingest(cbor2.dumps([[NODE, body]]))
    with stand.cloud.store.read() as connection:
        assert connection.execute(select(dead_letters.c.data)).scalars().all() == [body]
