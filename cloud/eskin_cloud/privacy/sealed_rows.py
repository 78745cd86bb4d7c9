"""Rows of sealed messages, opened; one that is damaged is noted and left out, as a gap is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from eskin.errors import BrokenSealError, MessageError
from eskin.privacy import SealedMessage
from eskin_cloud.store.damage import DamagedRow, report_damaged

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy import RowMapping

    from eskin.wire.messages import Block, Peak


class Reader(Protocol):
    """Opens what is sealed."""

    def read(self, node: str, veiled: SealedMessage) -> tuple[Block | Peak, bytes]:
        """The block or peak that was sealed, and its bytes.

        Raises:
            PrivacyError: It cannot be read.
        """


def open_row(
    reader: Reader, row: Mapping[str, Any] | RowMapping
) -> tuple[Block | Peak, bytes] | None:
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
        report_damaged(
            "sealed_messages", DamagedRow(row["node"], row["boot"], row["sequence"], None)
        )
        return None
