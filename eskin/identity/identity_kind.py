"""Who takes part, and how each kind is named.

A node's common name is its id and never holds a dot; every other kind's is ``kind.name``. So names
are unique across kinds, and a certificate of one kind never reads as one of another.
"""

from __future__ import annotations

import re
from enum import StrEnum
from typing import Final

from eskin.errors import IdentityError

_LABEL: Final = "[a-z0-9][a-z0-9_-]{0,62}"


class IdentityKind(StrEnum):
    """Kinds of identities; each has an issuing CA of its own."""

    NODE = "node"
    SITE = "site"
    GATEWAY = "gateway"
    SERVER = "server"
    CLIENT = "client"

    @property
    def issuer(self) -> str:
        """Common name of the kind's issuing CA."""
        return f"eskin {self} CA"

    @property
    def has_site(self) -> bool:
        """Whether its certificates name a site: what a node or gateway may do, it may there."""
        return self in {IdentityKind.NODE, IdentityKind.GATEWAY}

    def require_site(self, site: str) -> str:
        """Check the site of an identity of this kind; empty where it has none.

        Raises:
            IdentityError: It is missing, none, or this kind has no site.
        """
        if self.has_site and not site:
            raise IdentityError(f"a {self} belongs to a site; name it, such as site.main")
        if self.has_site:
            return IdentityKind.SITE.require_name(site)
        if site:
            raise IdentityError(f"a {self} has no site; leave {site[:100]!r} out")
        return site

    def require_name(self, name: str) -> str:
        """Check a common name of this kind.

        Raises:
            IdentityError: It is none.
        """
        pattern = _LABEL if self is IdentityKind.NODE else rf"{self}\.{_LABEL}"
        if re.fullmatch(pattern, name) is None:
            example = "fingertip" if self is IdentityKind.NODE else f"{self}.main"
            raise IdentityError(
                f"{name[:100]!r} is no name of a {self}; use small letters, digits, - and _ "
                f"such as {example!r}"
            )
        return name


_DIGITS: Final = 4


def numbered(stem: str, count: int) -> list[str]:
    """``stem-0001`` and so on: as many names, of equal length, in the order of the alphabet."""
    digits = max(_DIGITS, len(str(count)))
    return [f"{stem}-{number:0{digits}}" for number in range(1, count + 1)]


def is_numbered(name: str, stem: str, count: int) -> bool:
    """Whether a name is one of those that `numbered` gives."""
    number = name.removeprefix(f"{stem}-")
    digits = max(_DIGITS, len(str(count)))
    plain = len(number) == digits and number.isascii() and number.isdigit()
    return plain and name != number and 1 <= int(number) <= count
