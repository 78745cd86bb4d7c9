"""A command poller that is stopped closes its connection at once."""

from __future__ import annotations

import gc
import socket
import ssl
import warnings
from unittest.mock import Mock

from eskin_gateway.commands.poller import CommandPoller, CommandsClient
from eskin_gateway.commands.publisher import PendingCommands
from eskin_gateway.publish.alarms import AlarmPublisher
from eskin_gateway.upstream.cloud_client import CloudClient

from tests.unit.gateway.in_memory import quick


def test_poller_stopped_during_a_handshake_closes_its_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        client = CloudClient(
            [f"https://127.0.0.1:{silent.getsockname()[1]}/api/v1/ingest"],
            headers=dict,
            context=ssl.create_default_context(),
            timeout_s=200.0,
            abortable=True,
        )
        command_poller = CommandPoller(
            PendingCommands(5.0),
            AlarmPublisher(None),
            commands_client=CommandsClient(client),
            wait_s=1.0,
            backoff=quick(),
            metrics=Mock(),
        )
        command_poller.start()
        peer, _ = silent.accept()
        with peer:
            assert peer.recv(1) == b"\x16"  # The handshake's first record (RFC 8446, 5.1).
            command_poller.stop()
            with warnings.catch_warnings(record=True) as stated:
                warnings.simplefilter("always")
                del command_poller, client
                gc.collect()
    assert [str(one.message) for one in stated] == []
