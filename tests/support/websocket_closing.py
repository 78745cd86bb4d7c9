"""What ends a WebSocket."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

import pytest
from websockets.exceptions import ConnectionClosed

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

_PATIENCE_S: Final = 20.0


async def close_code(connection: ClientConnection) -> int:
    """The code with which the server closes, whatever comes before; it gives a reason, too."""

    async def read_all() -> None:
        while True:
            await connection.recv()

    with pytest.raises(ConnectionClosed) as caught:
        await asyncio.wait_for(read_all(), _PATIENCE_S)
    assert caught.value.rcvd is not None
    assert caught.value.rcvd.reason
    return caught.value.rcvd.code
