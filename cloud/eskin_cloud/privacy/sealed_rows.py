"""Rows of sealed messages, opened; one that is damaged is noted and left out, as a gap is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from eskin.errors import BrokenSealError, MessageError
from eskin.privacy import SealedMessage
from eskin.wire.frames import Statements
from eskin_cloud.store.damage import DamagedRow, report_damaged
from eskin_cloud.store.write.events import statement_rows

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy import RowMapping

    from eskin.privacy.cipher import Sealable
    from eskin.wire.frames import DescribedLayout


class SealedReader(Protocol):
    """Opens what is sealed."""

    def read(self, node: str, sealed: SealedMessage, /) -> tuple[Sealable, bytes]:
        """The message that was sealed, and its bytes.

        Raises:
            PrivacyError: It cannot be read.
        """


def event_rows(
    node: str, message: Sealable, data: bytes, described: DescribedLayout | None, cursor: int
) -> list[dict[str, Any]]:
    """Rows of events that an opened message gives, all with its cursor; ``number`` counts them.

    Args:
        node: The node.
        message: The message; frames give none.
        data: Its bytes.
        described: The layout by which statements are read; without it they give none.
        cursor: Its cursor in the feed.
    """
    if not isinstance(message, Statements) or described is None:
        return []
    rows = statement_rows(node, message, described, data)
    return [row | {"cursor": cursor, "number": k} for k, row in enumerate(rows)]


def open_row(
    reader: SealedReader, row: Mapping[str, Any] | RowMapping
) -> tuple[Sealable, bytes] | None:
    """What a row holds; ``None`` where it is not as it was written.

    Args:
        reader: Opens it.
        row: With node, boot, sequence and data.

    Raises:
        NoKeyError: Its subject's key is not here.
        PrivacyError: A key cannot be read.
    """
    try:
        return reader.read(row["node"], SealedMessage.decode(row["data"]))
    except (BrokenSealError, MessageError):
        report_damaged("sealed_messages", DamagedRow(row["node"], row["boot"], row["sequence"]))
        return None
