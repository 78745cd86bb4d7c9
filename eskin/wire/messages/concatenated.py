"""Messages side by side, for one compiled look at all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class Joined(NamedTuple):
    """Messages side by side.

    Attributes:
        data: Their bytes.
        ends: Where each of them ends, shape ``(messages,)``; the next one begins there.
    """

    data: bytes
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, messages: Sequence[bytes]) -> Self:
        """Put messages side by side."""
        sizes = np.fromiter(map(len, messages), np.int64, len(messages))
        return cls(b"".join(messages), np.cumsum(sizes))
