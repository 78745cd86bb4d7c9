"""What is damaged, or made to be misread, is stated as such and never breaks what reads it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from eskin_ca.csr import make_request, requested_name
from eskin_ca.tokens import Tokens

from eskin.errors import IdentityError
from eskin.identity import new_key

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    "text",
    ["no JSON", "[{}]", "[1]", '{"name": 1}', '[{"name": "n", "kind": "robot", "hosts": []}]'],
)
def test_tokens_that_are_none_are_reported(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tokens.json"
    path.write_text(text)
    with pytest.raises(IdentityError, match=r"tokens\.json: enrolment tokens cannot be read"):
        Tokens(path)


def test_common_name_that_is_no_text_is_reported() -> None:
    request = make_request(new_key(), "fingertip").public_bytes(Encoding.DER)
    assert requested_name(request) == "fingertip"
    with pytest.raises(IdentityError, match="no PKCS #10 request"):
        requested_name(request.replace(b"fingertip", b"finger\xff\xfe\xfd"))
