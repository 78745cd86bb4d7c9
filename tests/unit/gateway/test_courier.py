"""A courier that is stopped leaves nothing open, at whatever point it was."""

from __future__ import annotations

import gc
import socket
import ssl
import warnings
from unittest.mock import Mock

from eskin_gateway.commands.poller import CommandPoller
from eskin_gateway.upstream.commands_client import HttpsDeliveries


def test_courier_stopped_in_the_middle_of_a_handshake_closes_its_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        commands_client = HttpsDeliveries(
            f"https://127.0.0.1:{silent.getsockname()[1]}/api/v1/ingest",
            headers=dict,
            context=ssl.create_default_context(),
            timeout_s=20.0,
        )
        command_poller = CommandPoller(
            Mock(**{"held.return_value": []}),
            commands_client=commands_client,
            wait_s=1.0,
            backoff=Mock(),
            metrics=Mock(),
        )
        command_poller.start()
        peer, _ = silent.accept()
        with peer:
            assert peer.recv(1) == b"\x16"  # The handshake's first record (RFC 8446, 5.1).
            command_poller.stop()
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                del command_poller, commands_client
                gc.collect()
    assert [str(one.message) for one in told] == []
