"""What is compiled, on disk: as fresh as its sources, written and read by one process at a time."""

from __future__ import annotations

import fcntl
import functools
import hashlib
import logging
import os
import pickle
import tempfile
import time
from contextlib import contextmanager, suppress
from enum import EnumType
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

import numba
import numpy as np
from numba.core import serialize
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

log = logging.getLogger(__name__)


def enable_cache(made: Any) -> None:
    """Keep what is compiled of a function on disk; nothing is kept where nothing can be written.

    Args:
        made: What numba makes of the function.
    """
    try:
        made.enable_caching()
    except RuntimeError:  # numba found no folder to write to
        return
    cache = made._cache  # noqa: SLF001 - has no other way
    path = Path(cache._cache_file._index_path).with_suffix(".kernel")  # noqa: SLF001 - likewise
    # numba looks at the kernel's own file alone, and would keep old parts in new kernels. What is
    # damaged it would run, or end by.
    cache._cache_file = KernelFile(path, _Stamps(made.py_func))  # noqa: SLF001 - likewise
    cache.save_overload = _where_possible(cache.save_overload)
    made.compile = _one_at_a_time(made.compile, path.with_suffix(".lock"))


def has_cache(made: Any) -> bool:
    """Whether what is compiled of a kernel is kept on disk."""
    return made._cache.cache_path is not None  # noqa: SLF001 - has no other way


@functools.cache
def _digest(path: str) -> bytes:
    """Of a source file; its time changes in a checkout, and in an image that is pulled."""
    return hashlib.sha256(Path(path).read_bytes()).digest()


class _Stamps:
    """SHA-256 of the files that a kernel and the parts in it come from, and of their constants.

    A constant that is imported stands in the machine code, and its own file is none of these. All
    are looked up when numba first asks: when a kernel is made, parts below it are still to come.
    """

    __hash__ = None  # type: ignore[assignment]  # equal only until a file changes

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __eq__(self, other: object) -> bool:
        return self._found == other

    def __reduce__(self) -> tuple[type, tuple[list[tuple[str, bytes]]]]:
        return list, (self._found,)

    @functools.cached_property
    def _found(self) -> list[tuple[str, bytes]]:
        known: set[Any] = set()
        constants: dict[str, bytes] = {}
        waiting: list[Any] = [self._function]
        while waiting:
            each = waiting.pop()
            known.add(each)
            names = each.__code__.co_names
            used = [(name, each.__globals__.get(name)) for name in names]
            # What is named by its module: the attribute's name stands beside the module's.
            modules = [value for _, value in used if isinstance(value, ModuleType)]
            used += [(name, getattr(module, name, None)) for module in modules for name in names]
            parts = (value.py_func for _, value in used if isinstance(value, Dispatcher))
            waiting += [found for found in parts if found not in known]
            for name, value in used:
                if _is_constant(value):
                    constants[f"{each.__module__}.{name}"] = _digest_of(value)
        files = {each.__code__.co_filename for each in known}
        return [*((name, _digest(name)) for name in sorted(files)), *sorted(constants.items())]


_CONSTANTS: Final = (int, float, complex, str, bytes, EnumType, np.generic, np.ndarray)
"""Types of values that numba writes into machine code, and whose text is equal in each process."""


def _is_constant(value: object) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return isinstance(value, _CONSTANTS)


def _digest_of(constant: Any) -> bytes:
    if isinstance(constant, np.ndarray):
        return hashlib.sha256(repr(constant.dtype).encode() + constant.tobytes()).digest()
    shown = [*constant] if isinstance(constant, EnumType) else constant
    return hashlib.sha256(repr(shown).encode()).digest()


def _where_possible(save: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
    """A full disk must not stop a process from using what it compiled."""

    def save_overload(signature: Any, made: Any) -> None:
        try:
            save(signature, made)
        except OSError as error:
            log.warning("a kernel is compiled anew at the next start: reason=%s", error)

    return save_overload


def _one_at_a_time(find: Callable[[Any], Any], lock: Path) -> Callable[[Any], Any]:
    """Of processes that need a kernel at the same time let one compile, and the others wait.

    Args:
        find: Looks a signature up on disk, or compiles and saves it.
        lock: Held meanwhile.
    """

    def compile_(signature: Any) -> Any:
        # Threads first, as inside of numba: no thread holds a kernel that it does not work at.
        with global_compiler_lock, _held(lock):
            return find(signature)

    return compile_


@contextmanager
def _held(lock: Path) -> Iterator[None]:
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:  # a full disk: each process compiles for itself
        yield
        return
    try:
        _wait_for(descriptor, lock)
        yield
    finally:
        # By name: a process that was forked meanwhile holds the same descriptor.
        fcntl.flock(descriptor, fcntl.LOCK_UN)
        os.close(descriptor)


def _wait_for(descriptor: int, lock: Path) -> None:
    """Lock a file; waiting for a process that was stopped with the lock ends."""
    begun, stated = time.monotonic(), False
    while True:
        with suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        waited = time.monotonic() - begun
        if waited > MOST_WAIT_S:
            log.warning(
                "a kernel is compiled here, too: another process holds its lock: file=%s "
                "waited_s=%.0f", lock, waited,
            )  # fmt: skip
            return
        if waited > _STATED_S and not stated:
            stated = True
            log.warning("waiting for a kernel that another process compiles: file=%s", lock)
        time.sleep(_POLL_S)


_POLL_S: Final = 0.02
_STATED_S: Final = 10.0
MOST_WAIT_S: Final = 120.0
"""Beyond the time that the longest kernel takes on a busy machine."""
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
