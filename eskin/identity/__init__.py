"""Who is who: keys, certificates, trust, TLS."""

from __future__ import annotations

from eskin.identity.authority import Authority, Issued
from eskin.identity.certificates import common_name, der, issuer_kind, new_key, thumbprint
from eskin.identity.identity import Identity, load_certificates
from eskin.identity.kinds import IdentityKind
from eskin.identity.numbered import numbered
from eskin.identity.tls import client_context, server_context
from eskin.identity.trust import Trust

__all__ = [
    "Authority",
    "Identity",
    "IdentityKind",
    "Issued",
    "Trust",
    "client_context",
    "common_name",
    "der",
    "issuer_kind",
    "load_certificates",
    "new_key",
    "numbered",
    "server_context",
    "thumbprint",
]
