"""Asking the CA service, over TLS that leads to a root that is trusted."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Final, TypeVar

import httpx

from eskin.errors import IdentityError
from eskin.identity import client_context
from eskin.identity.identity import ROOT_FILE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

T = TypeVar("T")

_TIMEOUT_S: Final = 10.0
_LATER: Final = {httpx.codes.NOT_FOUND, httpx.codes.TOO_MANY_REQUESTS}


class NotReadyError(IdentityError):
    """The service, the token or the certificate is not there yet; ask again."""


def patiently(ask: Callable[[], T], patience: float) -> T:
    """Ask again each second while the service is away or not ready.

    Raises:
        IdentityError: It was for as many seconds as patience lasts.
    """
    deadline = time.monotonic() + patience
    while True:
        try:
            return ask()
        except NotReadyError as error:
            if time.monotonic() > deadline:
                raise IdentityError(f"gave up after {patience:g} s: {error}") from error
            time.sleep(1.0)


class Connection:
    """A connection to the service that is made when it is first needed, and stays."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._client: httpx.Client | None = None

    def client(self) -> httpx.Client:
        """The connection.

        Raises:
            NotReadyError: The root's certificate is not there yet.
        """
        if self._client is None:
            self._client = _client(self._directory)
        return self._client

    def close(self) -> None:
        """Close it."""
        if self._client is not None:
            self._client.close()


def _client(directory: Path) -> httpx.Client:
    root = directory / ROOT_FILE
    waited(root)
    return httpx.Client(verify=client_context(root), timeout=_TIMEOUT_S)


def ask(
    method: str,
    url: str,
    directory: Path,
    path: str,
    body: dict[str, str] | None,
    client: httpx.Client | None = None,
) -> httpx.Response:
    """Ask once.

    Args:
        method: Of HTTP.
        url: The CA service.
        directory: Holds ``root.pem``.
        path: What is asked for.
        body: As JSON.
        client: A connection that stays.

    Raises:
        NotReadyError: The service is away or busy, or what is asked for is not there yet.
        IdentityError: The service refuses.
    """
    own = client or _client(directory)
    try:
        with contextlib.nullcontext(own) if client else own:
            answer = own.request(method, url.rstrip("/") + path, json=body)
    except httpx.TransportError as error:
        raise NotReadyError(f"{url} cannot be reached: {error}") from error
    if answer.status_code in _LATER or answer.is_server_error:
        raise NotReadyError(f"{url}{path} answered {answer.status_code}: {answer.text[:200]}")
    if answer.is_error:
        raise IdentityError(f"{url}{path} refused: {answer.text[:300]}")
    return answer


def waited(path: Path) -> bytes:
    """Read a file that the CA service, or another process, writes.

    Raises:
        NotReadyError: It is not there.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise NotReadyError(f"{path} cannot be read: {error.strerror}") from error
