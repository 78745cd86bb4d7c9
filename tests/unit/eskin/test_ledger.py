"""The ledger outlives power cuts and full disks, and says where it is damaged."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

import pytest
from eskin_ca.tokens import TokenUses

from eskin.errors import IdentityError
from eskin.identity import CertificateAuthority, IdentityKind, new_key
from eskin.identity.issuance_log import IssuanceLog, Issued
from eskin.runtime.digest import with_check
from eskin.runtime.files.append_log import append_lines
from tests.support.identities import SITE

if TYPE_CHECKING:
    from pathlib import Path

NODE = IdentityKind.NODE
PALM = Issued("a1", "node", "palm", "2030-01-01T00:00:00+00:00", key="k1")
SOLE = Issued("b2", "node", "sole", "2030-01-01T00:00:00+00:00", key="k2")
LINE = json.dumps(with_check(asdict(SOLE))) + "\n"


@pytest.mark.parametrize("left", [1, 40, len(LINE) - 1])
def test_line_that_was_cut_off_goes_before_the_next_one(tmp_path: Path, left: int) -> None:
    path = tmp_path / "ledger.jsonl"
    reader, writer = IssuanceLog(path), IssuanceLog(path)
    writer.add(PALM)
    with path.open("a") as file:
        file.write(LINE[:left])
    assert reader.entries() == [PALM]
    writer.add(SOLE)
    for ledger in (reader, writer, IssuanceLog(path)):
        assert ledger.entries() == [PALM, SOLE]
        assert ledger.length() == 2


@pytest.mark.parametrize("whole", ["", "a\n", "a\n" * 40_000])
def test_end_of_what_is_whole_is_found_however_long_the_rest(tmp_path: Path, whole: str) -> None:
    path = tmp_path / "lines"
    path.write_text(whole + "b" * 200_000)
    append_lines(path, "c\n")
    assert path.read_text() == whole + "c\n"


@pytest.mark.parametrize(
    "damage",
    ["{}", "[]", LINE[:40], LINE[:40] + LINE[:-1], "\0" * 9, LINE[:-1].replace("b2", "b3"),
     LINE[:-1].replace("k2", "k3"), LINE[:-1].replace("null", "0")],
)  # fmt: skip
def test_damaged_line_is_named_with_place_and_remedy(tmp_path: Path, damage: str) -> None:
    authority = CertificateAuthority.open(tmp_path)
    authority.issue(NODE, "palm", new_key().public_key(), site=SITE)
    ledger = tmp_path / "ledger.jsonl"
    whole = ledger.read_bytes()
    ledger.write_bytes(whole + damage.encode() + b"\n" + LINE.encode())
    for _ in range(2):
        for ask in (authority.issued, lambda: authority.revoke("palm")):
            with pytest.raises(IdentityError, match=r"ledger\.jsonl: line 2 is damaged.*backup"):
                ask()
    ledger.write_bytes(whole + LINE.encode())
    assert [entry.name for entry in authority.issued()] == ["palm", "sole"]


def test_use_of_a_fleets_token_that_was_cut_off_keeps_the_others(tmp_path: Path) -> None:
    path = tmp_path / "tokens.used"
    TokenUses(path).bind("skin-0001", "k1")
    with path.open("a") as file:
        file.write('{"name": "skin-0002", "k')
    uses = TokenUses(path)
    uses.bind("skin-0003", "k3")
    assert [TokenUses(path).key(f"skin-000{k}") for k in (1, 2, 3)] == ["k1", None, "k3"]
