"""Who is who: keys, certificates, trust, TLS."""

from __future__ import annotations

from eskin.identity.ca import CertificateAuthority
from eskin.identity.certificates import common_name, der, issuer_kind, new_key, site_of, thumbprint
from eskin.identity.chain_verifier import ChainVerifier
from eskin.identity.identity import Identity, load_certificates
from eskin.identity.identity_kind import IdentityKind, is_numbered, numbered
from eskin.identity.issuance_log import Issued
from eskin.identity.renewal import (
    finish_renewal,
    forget_past,
    install,
    is_due,
    is_superseded,
    next_key,
    past_identities,
)
from eskin.identity.revocation_file import RevocationFile
from eskin.identity.rotation import RootRotation
from eskin.identity.tls import client_context, server_context

__all__ = [
    "CertificateAuthority",
    "ChainVerifier",
    "Identity",
    "IdentityKind",
    "Issued",
    "RevocationFile",
    "RootRotation",
    "client_context",
    "common_name",
    "der",
    "finish_renewal",
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
    "site_of",
    "thumbprint",
]
