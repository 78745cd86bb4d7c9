"""Who is who: keys, certificates, trust, TLS."""

from __future__ import annotations

from eskin.identity.authority import Authority
from eskin.identity.certificates import common_name, der, issuer_kind, new_key, site_of, thumbprint
from eskin.identity.identity import Identity, load_certificates
from eskin.identity.kinds import IdentityKind
from eskin.identity.ledger import Issued
from eskin.identity.numbered import is_numbered, numbered
from eskin.identity.renewal import (
    forget_past,
    install,
    is_due,
    is_superseded,
    next_key,
    past_identities,
    settle,
)
from eskin.identity.revocation_file import RevocationFile
from eskin.identity.rotation import RootRotation
from eskin.identity.tls import client_context, server_context
from eskin.identity.trust import Trust

__all__ = [
    "Authority",
    "Identity",
    "IdentityKind",
    "Issued",
    "RevocationFile",
    "RootRotation",
    "Trust",
    "client_context",
    "common_name",
    "der",
    "forget_past",
    "install",
    "is_due",
    "is_numbered",
    "is_superseded",
    "issuer_kind",
    "load_certificates",
    "new_key",
    "next_key",
    "numbered",
    "past_identities",
    "server_context",
    "settle",
    "site_of",
    "thumbprint",
]
