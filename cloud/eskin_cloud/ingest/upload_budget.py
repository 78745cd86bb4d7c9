"""Room in memory for batches that are on their way into the store."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from eskin.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Iterator


class UploadBudget:
    """Bounds what all requests together hold in memory; on the event loop only.

    Args:
        most: Bytes.

    Attributes:
        used: Bytes that are held now.
        taken: Bytes that were ever held.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self.used = self.taken = 0

    @contextmanager
    def hold(self, size: int) -> Iterator[None]:
        """Hold so many bytes while the block runs.

        Raises:
            StoreError: There is no room now.
        """
        if self.used + size > self._most:
            raise StoreError(
                f"batches of {self.used} bytes wait to be stored already, and {size} more do not "
                f"fit into {self._most} (gateways.uploads_bytes); try again in an instant"
            )
        self.used += size
        self.taken += size
        try:
            yield
        finally:
            self.used -= size
