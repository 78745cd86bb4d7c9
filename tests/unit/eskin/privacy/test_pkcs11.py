"""The master key in hardware, with SoftHSM in its place."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from pkcs11 import Attribute, AttributeSensitive

from eskin.errors import PrivacyError, SettingsError
from eskin.privacy import open_key, open_keystore
from eskin.privacy.pkcs11 import LABEL, Pkcs11MasterKey
from eskin.runtime.settings import KeysSection

MODULE = Path("/usr/lib/softhsm/libsofthsm2.so")


@pytest.fixture(scope="module")
def token(tmp_path_factory: pytest.TempPathFactory) -> KeysSection:
    folder = tmp_path_factory.mktemp("hsm")
    (folder / "tokens").mkdir()
    (folder / "softhsm2.conf").write_text(f"directories.tokendir = {folder / 'tokens'}\n")
    os.environ["SOFTHSM2_CONF"] = str(folder / "softhsm2.conf")  # read by the library, once
    pin = folder / "pin"
    pin.write_text("2718\n")
    pin.chmod(0o600)
    for label in ("eskin", "locked"):
        command = ["softhsm2-util", "--init-token", "--free", "--label", label, "--pin", "2718"]
        subprocess.run([*command, "--so-pin", "31415"], check=True, capture_output=True)
    return KeysSection(module=MODULE, pin=pin)


def test_keys_are_wrapped_by_the_token_and_no_master_file_is_made(
    token: KeysSection, tmp_path: Path
) -> None:
    made = open_keystore(token, tmp_path).create("Ada")
    again = open_keystore(token, tmp_path)
    assert again.find(made.pseudonym) == made
    assert not (tmp_path / "master.key").exists()
    files = [path for path in (tmp_path / "subjects").iterdir() if path.name != made.pseudonym]
    assert files == []
    path = tmp_path / "subjects" / made.pseudonym
    body = path.read_bytes()
    path.write_bytes(body[:-1] + bytes([body[-1] ^ 1]))
    with pytest.raises(PrivacyError, match="was not wrapped by token"):
        open_keystore(token, tmp_path).find(made.pseudonym)


def test_master_key_does_not_come_out_of_the_token(token: KeysSection, tmp_path: Path) -> None:
    open_keystore(token, tmp_path).create()
    assert token.module is not None
    assert token.pin is not None
    key = Pkcs11MasterKey(token.module, token.token, token.pin)._key
    assert key.label == LABEL
    with pytest.raises(AttributeSensitive):
        key[Attribute.VALUE]


def test_key_of_a_flash_is_wrapped_by_the_token(token: KeysSection, tmp_path: Path) -> None:
    key = open_key(token, tmp_path, "hand.flash")
    assert open_key(token, tmp_path, "hand.flash") == key
    assert open_key(token, tmp_path, "palm.flash") != key
    assert key not in (tmp_path / "hand.flash").read_bytes()
    assert not (tmp_path / "master.key").exists()
    (tmp_path / "hand.flash").rename(tmp_path / "palm.flash")
    with pytest.raises(PrivacyError, match=r"palm\.flash was not wrapped by token"):
        open_key(token, tmp_path, "palm.flash")


def test_wrong_pin_missing_token_and_open_pin_file_are_refused(
    token: KeysSection, tmp_path: Path
) -> None:
    pin = tmp_path / "pin"
    pin.write_text("0000")
    pin.chmod(0o600)
    for wrong in (
        {"pin": pin, "token": "locked"},
        {"token": "other"},
        {"module": tmp_path / "none.so"},
    ):
        with pytest.raises(PrivacyError, match="cannot be used"):
            open_keystore(token.model_copy(update=wrong), tmp_path / "keys")
    pin.chmod(0o644)
    with pytest.raises(PrivacyError, match="chmod 600"):
        open_keystore(token.model_copy(update={"pin": pin}), tmp_path / "keys")
    with pytest.raises(SettingsError, match=r"keys\.pin"):
        open_keystore(token.model_copy(update={"pin": None}), tmp_path / "keys")
