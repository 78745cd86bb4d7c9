"""amqtt 0.12.1 with its holes closed; serves the demo on loopback and nothing else.

- Client certificates are required (amqtt asks for them but takes clients without).
- A session belongs to its certificate: the client id is prefixed with the certificate's name
  (in amqtt, a certificate of n2 with client id n1 took over n1's session).
- Sessions are clean, so no queue grows for a client that is away.
- A retained message goes to those who subscribed (amqtt sends every new connection what any client
  else has subscribed to).
- A revoked client is rejected, and an open connection ends within seconds.
- Wills obey the access rules, as publishing and reading do (amqtt publishes wills unchecked).
- A packet that announces more than any legitimate message is refused before its body is read, and a
  certificate has at most 16 connections, which bounds what its unfinished packets hold.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from contextlib import suppress
from typing import TYPE_CHECKING, Final, Self

from amqtt.adapters import StreamReaderAdapter, StreamWriterAdapter
from amqtt.broker import Broker
from amqtt.contexts import Action, BrokerConfig, ListenerConfig
from amqtt.errors import MQTTError, NoDataError
from amqtt.mqtt.connect import ConnectPacket
from amqtt.mqtt.packet import MQTTFixedHeader
from amqtt.mqtt.protocol import handler as amqtt_handler
from amqtt.mqtt.protocol.broker_handler import BrokerProtocolHandler
from amqtt.utils import gen_client_id

from eskin.demo.broker.access import Party, may_publish, may_subscribe
from eskin.errors import IdentityError
from eskin.identity import server_context
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE
from eskin.wire.envelope import MOST_ENVELOPE

if TYPE_CHECKING:
    import ssl
    from asyncio import StreamWriter
    from collections.abc import Callable

    from amqtt.adapters import ReaderAdapter, WriterAdapter
    from amqtt.mqtt.publish import PublishPacket
    from amqtt.session import Session

    from eskin.demo.broker.client_auth import ClientAuth
    from eskin.identity import Identity

MOST_REMAINING: Final = MOST_ENVELOPE + 2 + 65_535 + 2
"""Greatest remaining length of a packet, in bytes: the largest envelope, the longest topic with its
length, and a packet identifier (MQTT 3.1.1, sections 2.2.3 and 3.3)."""


class FixedHeader(MQTTFixedHeader):  # type: ignore[misc]  # amqtt ships no types
    """A fixed header whose remaining length is checked before any of the body is read.

    amqtt takes up to 256 MB, and keeps what has arrived for as long as the client sends no more.
    """

    @classmethod
    async def from_stream(cls, reader: ReaderAdapter) -> Self | None:
        """Read a fixed header; ``None`` where the stream ends, or the packet is too large.

        amqtt closes the connection in both cases; after an `MQTTError` it would read on.
        """
        header: Self | None = await super().from_stream(reader)
        if header is not None and header.remaining_length > MOST_REMAINING:
            log.warning(
                "packet too large: bytes=%d most=%d", header.remaining_length, MOST_REMAINING
            )
            return None
        return header


# amqtt has no other place where the check can go: its loop over packets names the class itself.
amqtt_handler.MQTTFixedHeader = FixedHeader
ConnectPacket.FIXED_HEADER = FixedHeader


class Handler(BrokerProtocolHandler):  # type: ignore[misc]  # amqtt ships no types
    """Drops messages without a subscriber on arrival.

    A gateway publishes for other clients whether or not there are any, and each message costs amqtt
    two queues and five tasks.

    Attributes:
        is_heard: Whether a client has subscribed to a topic.
    """

    is_heard: Callable[[str], bool]

    async def handle_publish(self, publish_packet: PublishPacket) -> None:
        """Accept a message, unless it is of QoS 0, not retained, and without a subscriber."""
        kept = publish_packet.qos or publish_packet.retain_flag
        if kept or self.is_heard(publish_packet.topic_name):
            await super().handle_publish(publish_packet)


log = logging.getLogger(__name__)

PARTY: Final = "eskin.party"
CERTIFICATE: Final = "eskin.certificate"
WRITER: Final = "eskin.writer"
LOOPBACK: Final = "127.0.0.1"
CONNECT_TIMEOUT_S: Final = 10.0
MOST_CONNECTIONS: Final = 16
"""Of one certificate; with the greatest packet, this bounds what its unfinished packets hold."""
_LOOK_S: Final = 1.0
_CLOSE_S: Final = 2.0


class LoopbackBroker(Broker):  # type: ignore[misc]  # amqtt ships no types
    """An MQTT 3.1.1 broker on 127.0.0.1 with TLS and client certificates.

    Args:
        identity: The broker's own, of kind server.
        client_auth: Decides which clients may connect.
        port: Where to listen.
    """

    def __init__(self, identity: Identity, *, client_auth: ClientAuth, port: int) -> None:
        self._client_auth = client_auth
        self._identity = identity
        self._connections: Counter[bytes] = Counter()
        directory = identity.directory
        listener = ListenerConfig(
            bind=f"{LOOPBACK}:{port}",
            ssl=True,
            cafile=directory / ROOT_FILE,
            certfile=directory / CHAIN_FILE,
            keyfile=directory / KEY_FILE,
        )
        super().__init__(BrokerConfig(listeners={"default": listener}, plugins={}))

    def _create_ssl_context(self, listener: ListenerConfig) -> ssl.SSLContext:
        del listener
        return server_context(self._identity.directory, client_certificates=True)

    async def stream_connected(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, listener_name: str
    ) -> None:
        """As amqtt does, with a writer that writes seldom, and a bound on connections."""
        gathering = BatchingWriter(writer)
        tls = gathering.get_ssl_info()
        certificate = (tls and tls.getpeercert(binary_form=True)) or b""
        if self._connections[certificate] >= MOST_CONNECTIONS:
            log.warning("refused: reason=too many connections of one certificate")
            await _close(gathering)
            return
        self._connections[certificate] += 1
        try:
            await self._client_connected(listener_name, StreamReaderAdapter(reader), gathering)
        finally:
            self._connections[certificate] -= 1
            if not self._connections[certificate]:
                del self._connections[certificate]

    async def _initialize_client_session(
        self, reader: ReaderAdapter, writer: WriterAdapter, remote_address: str, remote_port: int
    ) -> tuple[Handler, Session]:
        """As amqtt does, but bound to the certificate; raises `MQTTError` for a refusal."""
        del remote_address, remote_port
        tls = writer.get_ssl_info()
        try:
            certificate = tls.getpeercert(binary_form=True) if tls else None
            party = self._client_auth.admit(certificate)
        except IdentityError as error:
            await _close(writer)
            raise MQTTError(str(error)) from error
        handler, session = await self._connect(reader, writer)
        log.info("connected: party=%s client=%.200r", party.name, session.client_id)
        session.attributes |= {PARTY: party, CERTIFICATE: certificate, WRITER: writer}
        session.client_id = f"{party.name}|{session.client_id or gen_client_id()}"
        session.clean_session = True
        session.parent = 0
        if session.will_flag and not may_publish(party, session.will_topic or ""):
            await _close(writer)
            raise MQTTError(f"{party.name} may not leave a will on {session.will_topic!r}")
        await self._delete_session(session.client_id)
        return handler, session

    async def keep_out_the_revoked(self) -> None:
        """Each second, end what changed revocation lists forbid."""
        while True:
            await asyncio.sleep(_LOOK_S)
            if self._client_auth.refresh():
                for session, _ in list(self.sessions.values()):
                    await self._check_again(session)

    async def _check_again(self, session: Session) -> None:
        try:
            self._client_auth.admit(session.attributes[CERTIFICATE])
        except IdentityError as error:
            log.warning("ended: client=%.200r reason=%s", session.client_id, error)
            # From here on nothing more is taken from it or given to it, even if it hangs.
            session.attributes[PARTY] = None
            await _close(session.attributes[WRITER])

    async def _connect(
        self, reader: ReaderAdapter, writer: WriterAdapter
    ) -> tuple[Handler, Session]:
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                handler, session = await Handler.init_from_connect(
                    reader, writer, self.plugins_manager
                )
                handler.is_heard = self._is_heard
                return handler, session
        except TimeoutError as error:
            await _close(writer)
            raise MQTTError(f"no CONNECT within {CONNECT_TIMEOUT_S:g} s") from error
        except (MQTTError, NoDataError):
            await _close(writer)
            raise

    def _is_heard(self, topic: str) -> bool:
        filters = self._subscriptions.items()
        return any(given and self._matches(topic, pattern) for pattern, given in filters)

    async def _publish_retained_messages_for_subscription(
        self, subscription: tuple[str, int], session: Session
    ) -> None:
        subscribers = self._subscriptions.get(subscription[0], [])
        if any(subscriber is session for subscriber, _ in subscribers):
            await super()._publish_retained_messages_for_subscription(subscription, session)

    async def _authenticate(self, session: Session, _: ListenerConfig) -> bool:
        return isinstance(session.attributes.get(PARTY), Party)

    async def _topic_filtering(self, session: Session, topic: str, action: Action) -> bool:
        party = session.attributes.get(PARTY)
        if not isinstance(party, Party):
            return False
        allowed = (
            may_publish(party, topic) if action is Action.PUBLISH else may_subscribe(party, topic)
        )
        if not allowed:
            log.warning("refused: party=%s action=%s topic=%.200r", party.name, action, topic)
        return allowed


async def _close(writer: WriterAdapter) -> None:
    """Close a connection, whatever its peer does or still sends."""
    with suppress(TimeoutError, OSError):
        async with asyncio.timeout(_CLOSE_S):
            await writer.close()


class BatchingWriter(StreamWriterAdapter):  # type: ignore[misc]  # amqtt ships no types
    """Writes what came up in one turn of the event loop as one TLS record, by one system call.

    amqtt writes each packet by itself; with many small ones, that is a third of what a broker does.

    Args:
        writer: Of the connection.
    """

    def __init__(self, writer: StreamWriter) -> None:
        super().__init__(writer)
        self._loop = asyncio.get_running_loop()
        self._held: list[bytes | bytearray] = []

    def write(self, data: bytes | bytearray) -> None:
        """Write some bytes, with all others that come up in this turn."""
        if self.is_closed:
            return
        if not self._held:
            self._loop.call_soon(self._flush)
        self._held.append(data)

    async def close(self) -> None:
        """Write what is held, and close."""
        self._flush()
        await super().close()

    def _flush(self) -> None:
        held, self._held = self._held, []
        if held and not self.is_closed:
            self._writer.write(b"".join(held))
