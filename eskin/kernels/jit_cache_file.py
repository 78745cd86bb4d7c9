"""What is compiled of a kernel, in one file: it is whole, or as good as not there."""

from __future__ import annotations

import hashlib
import pickle
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numba
from numba.core import serialize

if TYPE_CHECKING:
    from collections.abc import Callable

_DIGEST: Final = hashlib.sha256().digest_size
_dumps: Final[Callable[[object], bytes]] = serialize.dumps
"""pickle's, for functions and types of numba's, too."""


class KernelFile:
    """A kernel's code for each signature that it was compiled for; numba's cache asks and fills it.

    Its SHA-256 comes first: what a power cut, a full disk or a bad one leaves of a file is never
    run, and the kernel is compiled anew.

    Args:
        path: The file.
        stamps: Of the sources; code of others is stale.
    """

    def __init__(self, path: Path, stamps: object) -> None:
        self._path = path
        self._stamps = stamps

    def load(self, key: object) -> Any:
        """The code for a signature; ``None`` if there is none."""
        code = self._read().get(key)
        return None if code is None else pickle.loads(code)  # noqa: S301 - it is code itself

    def save(self, key: object, code: object) -> None:
        """Keep the code for a signature.

        Raises:
            OSError: It cannot be written; what was there stays.
        """
        self._write({**self._read(), key: _dumps(code)})

    def flush(self) -> None:
        """Forget all code."""
        self._write({})

    def _read(self) -> dict[object, bytes]:
        try:
            whole = self._path.read_bytes()
        except OSError:
            return {}
        digest, rest = whole[:_DIGEST], whole[_DIGEST:]
        if hashlib.sha256(rest).digest() != digest:
            return {}
        made, codes = pickle.loads(rest)  # noqa: S301 - see above
        # What another numba wrote need not be readable.
        fresh = made == (numba.__version__, self._stamps)
        return pickle.loads(codes) if fresh else {}  # noqa: S301 - see above

    def _write(self, codes: dict[object, bytes]) -> None:
        rest = _dumps(((numba.__version__, self._stamps), _dumps(codes)))
        with tempfile.NamedTemporaryFile(dir=self._path.parent, delete=False) as partial:
            try:
                partial.write(hashlib.sha256(rest).digest() + rest)
                partial.flush()
                Path(partial.name).replace(self._path)
            except BaseException:
                with suppress(OSError):
                    Path(partial.name).unlink()
                raise
