"""Requests to the CA service: any path and body, over the whole application."""

from __future__ import annotations

import base64
import json
import logging
from contextlib import ExitStack
from datetime import timedelta
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives import serialization
from eskin_ca.app import create_application
from eskin_ca.csr import make_request
from eskin_ca.tokens import Tokens

from eskin.identity import IdentityKind, new_key
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.robustness.fuzz.asgi import Asker
from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.target import Target
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path


def make(folder: Path) -> Target:
    """The input is ``METHOD target``, an empty line, a body; none is answered by 5xx."""
    logging.getLogger("eskin_ca").setLevel(logging.CRITICAL)
    identities = Identities(folder / "identities")
    tokens = Tokens(folder / "tokens.json")
    token = tokens.create(IdentityKind.NODE, "palm", [], timedelta(days=3), lines=0)
    days = timedelta(days=30)
    asker = Asker(create_application(identities.authority, tokens, lifetime=days, grace=days))
    stack = ExitStack()
    stack.callback(asker.close)
    request = make_request(new_key(), "fingertip")
    asked = request.public_bytes(serialization.Encoding.PEM).decode()
    signed = sign(
        request.public_bytes(serialization.Encoding.DER), own=identities.node, topic=RENEWAL
    )
    bodies = {
        "enrol": {"token": token, "request": asked},
        "renew": {"signed": base64.b64encode(signed).decode()},
    }

    def check(data: bytes) -> None:
        head, _, body = data.partition(b"\n\n")
        method, _, target = head.partition(b" ")
        headers = [(b"host", b"ca"), (b"content-type", b"application/json")]
        headers.append((b"content-length", str(len(body)).encode()))
        answer = asker.ask(method.decode("latin-1"), b"/" + target.lstrip(b"/"), headers, body)
        assert answer.status < 500, answer
        assert b"Traceback" not in answer.body
        if answer.status >= 400:
            assert json.loads(answer.body)

    posted = [f"POST /{path}\n\n{json.dumps(body)}" for path, body in bodies.items()]
    kinds = [f"GET /{what}/node" for what in ("anchors", "revocations", "revoked")]
    seeds = (*posted, *kinds, "GET /certificates/fingertip", "GET /healthz", "GET /openapi.json")
    return Target(tuple(seed.encode() for seed in seeds), mutate_text, check, stack)
