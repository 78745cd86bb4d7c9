"""What fuzzing found once, each kept as the shortest input that showed it."""

from __future__ import annotations

import base64
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cryptography.hazmat.primitives import serialization
from eskin_ca.csr import der_of_pem, make_request
from eskin_cloud.settings import CloudSettings
from eskin_gateway.settings import GatewaySettings
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.spool import Spool
from eskin_sensor_node.kinds.settings import Rate
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.settings import NodeSettings
from eskin_sensor_node.world.replay.recording import read_recording
from eskin_sensor_node.world.replay.rows import read_rows
from eskin_sensor_node.world.scenario import read_scenario
from pydantic import TypeAdapter, ValidationError

from eskin.errors import (
    FlashError,
    IdentityError,
    MessageError,
    RecordingError,
    ScenarioError,
    SettingsError,
    SpoolError,
    UntrustedCertificateError,
)
from eskin.identity import ChainVerifier, IdentityKind, der, new_key
from eskin.wire.messages import Position
from tests.robustness.fuzz.targets import enrolment, requests
from tests.robustness.fuzz.targets.frame import check as check_frame
from tests.robustness.fuzz.targets.settings import NODE
from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.scenario.scripts import HEAD
from tests.unit.sensor_node.stores import Store

if TYPE_CHECKING:
    from tests.support.identities import Identities


@pytest.mark.parametrize("field", ["subject", "issuer"])
def test_name_that_is_no_text_is_an_untrusted_certificate(
    identities: Identities, field: str
) -> None:
    leaf, issuer = (der(certificate) for certificate in identities.node.chain)
    name = {"subject": b"fingertip", "issuer": b"eskin node CA"}[field]
    with pytest.raises(UntrustedCertificateError, match="no certificate that can be read"):
        ChainVerifier(*identities.authority.roots).verify(
            [leaf.replace(name, b"\xff" * len(name)), issuer], IdentityKind.NODE
        )


def test_revocation_list_with_such_a_certificate_is_refused(identities: Identities) -> None:
    damaged = der(identities.node.chain[1]).replace(b"eskin node CA", b"\xff" * 13)
    pem = b"-----BEGIN CERTIFICATE-----\n" + base64.encodebytes(damaged)
    with pytest.raises(UntrustedCertificateError, match="no revocation list"):
        ChainVerifier(*identities.authority.roots).revocations(
            IdentityKind.NODE, pem + b"-----END CERTIFICATE-----\n"
        )


@pytest.mark.parametrize("text", ["x = " + "9" * 5000, "x = " + "[" * 3000])
def test_toml_that_python_cannot_hold_is_a_clear_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match="no TOML that can be read"):
        GatewaySettings.load(path)
    with pytest.raises(ScenarioError, match="no TOML that can be read"):
        read_scenario(str(path))


def test_nested_setting_of_the_environment_is_a_clear_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ESKIN_BROKER", "[" * 3000)
    with pytest.raises(SettingsError, match="environment"):
        GatewaySettings.load()


def test_rate_whose_period_is_endless_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"greater than or equal to 0\.000001"):
        TypeAdapter(Rate).validate_python(1e-305)


def test_long_names_and_cells_are_shown_in_short(tmp_path: Path) -> None:
    path = tmp_path / "long.toml"
    path.write_text(f"{'a' * 5000} = 1")
    with pytest.raises(SettingsError) as setting:
        GatewaySettings.load(path)
    path.write_text(f'{NODE}[[taxel]]\nid = "t01"\nkind = "{"9" * 5000}"\n')
    with pytest.raises(SettingsError, match=r"'kind' is one of .*'pad'") as kind:
        NodeSettings.load(path)
    table = tmp_path / "long.csv"
    table.write_text(f"time,channel,value\n{'x' * 5000},a.b,1\n")
    with pytest.raises(RecordingError) as cell:
        read_recording(table)
    assert max(len(str(found.value)) for found in (setting, kind, cell)) < 1000


@pytest.mark.parametrize(
    "asked",
    [
        b"GET /nowhere?\x88",
        b"GET /nowhere\nHost: http://[",
        b"POST /logout\nOrigin: http://[",
        b"GET /assets/" + b"a" * 300,
        b"GET /%00",
        b'POST /api/v1/tokens\nContent-Type: application/json\n\n{"\\ud800": 1}',
    ],
)
def test_odd_request_is_refused_and_no_fault(tmp_path: Path, asked: bytes) -> None:
    target = requests.make(tmp_path)
    with target.stack:
        target.check(asked)


def test_odd_body_for_the_ca_is_refused_and_no_fault(tmp_path: Path) -> None:
    target = enrolment.make(tmp_path)
    with target.stack:
        target.check(b'POST /enrol\n\n{"\\ud800": "\\ud800"}')


def test_request_of_an_unknown_version_is_none() -> None:
    request = make_request(new_key(), "fingertip").public_bytes(serialization.Encoding.DER)
    version, later = b"\x02\x01\x00\x30", b"\x02\x01\x02\x30"  # and the subject after it
    pem = base64.encodebytes(request.replace(version, later, 1)).decode()
    with pytest.raises(IdentityError, match="not a valid CSR version"):
        der_of_pem(f"-----BEGIN CERTIFICATE REQUEST-----\n{pem}-----END CERTIFICATE REQUEST-----\n")


def test_key_without_end_in_a_scenario_is_shortened(tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(f'{HEAD}[[event]]\nkind = "hold"\n{"9" * 5000} = 1\n')
    with pytest.raises(ScenarioError) as error:
        read_scenario(str(path))
    assert len(str(error.value)) < 1000


def test_flash_or_spool_that_asks_for_too_much_memory_is_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As SQLite does of some damaged pages."""

    def refuse(*_: object, **__: object) -> NoReturn:
        raise MemoryError

    monkeypatch.setattr(sqlite3, "connect", refuse)
    with pytest.raises(FlashError, match="cannot be opened: the file is damaged, or"):
        open_flash(tmp_path / "flash.db")
    with pytest.raises(SpoolError, match="cannot be opened: the file is damaged, or"):
        Spool(tmp_path / "spool.db", capacity=1 << 20, max_dead_letters=5)


def test_flash_that_counts_no_boots_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "flash.db"
    open_flash(path).close()
    with sqlite3.connect(path) as database:
        never = "CREATE TRIGGER never BEFORE INSERT ON member BEGIN SELECT raise(IGNORE); END"
        database.execute(never)
        database.execute("DELETE FROM member")
    database.close()
    with pytest.raises(FlashError, match="damaged"):
        open_flash(path)


def test_damaged_page_is_noticed_when_it_is_opened(tmp_path: Path) -> None:
    flash, spool = tmp_path / "flash.db", tmp_path / "spool.db"
    open_flash(flash).close()
    Spool(spool, capacity=1000, max_dead_letters=5).close()
    for path in (flash, spool):
        image = bytearray(path.read_bytes())
        image[4096:4200] = b"\xff" * 104
        path.write_bytes(image)
    with pytest.raises(FlashError):
        open_flash(flash)
    with pytest.raises(SpoolError):
        Spool(spool, capacity=1000, max_dead_letters=5)


@pytest.mark.parametrize("ranges", [b"\x01", b"\xa1\x01\x02", b"\xa1\x01\x81\x82\x02\x01", b"\xff"])
def test_damaged_ranges_are_noticed(ranges: bytes) -> None:
    with pytest.raises(MessageError):
        NodeState.restore(Position(0, 0), ranges, None, None)


def test_host_without_end_is_refused_in_a_short_line(tmp_path: Path) -> None:
    path = tmp_path / "cloud.toml"
    path.write_text(f'[people]\nhost = "{"9" * 5000}"\n[gateways]\nidentity = "k"\n')
    with pytest.raises(SettingsError) as error:
        CloudSettings.load(path)
    assert len(str(error.value)) < 500


def test_file_that_cannot_be_opened_is_not_held(tmp_path: Path) -> None:
    for name, make, error in (
        ("spool", lambda path: Spool(path, capacity=1 << 20, max_dead_letters=5), SpoolError),
        ("truth", lambda path: GroundTruth(path, limit=1 << 20), FlashError),
    ):
        path = tmp_path / name
        path.write_bytes(b"no database" * 100)
        with pytest.raises(error):
            make(path)
        path.unlink()
        make(path).close()


def test_parquet_whose_names_are_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "recording.parquet"
    pq.write_table(pa.table({"tauiueux": [1.0], "value": [2.0]}), path)
    path.write_bytes(path.read_bytes().replace(b"tauiueux", b"\xc3auiueux"))
    with pytest.raises(RecordingError, match="no whole Parquet file"):
        list(read_rows(path))


def test_parquet_with_a_column_of_no_type_is_refused() -> None:
    path = Path(__file__).with_name("findings") / "column_of_no_type.parquet"
    with pytest.raises(RecordingError, match="it needs lo; it has time_ns, channel, hi"):
        list(read_rows(path))


def test_parquet_of_durations_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "recording.parquet"
    times = pa.array([2**62], pa.duration("us"))  # longer than Python's timedelta
    pq.write_table(pa.table({"time_ns": times, "channel": ["c"], "value": [2.0]}), path)
    with pytest.raises(RecordingError, match=r"time_ns is duration\[us\], neither number nor text"):
        list(read_rows(path))


def test_record_of_other_types_than_were_written_is_a_damaged_flash(tmp_path: Path) -> None:
    path = tmp_path / "flash.sqlite"
    store = Store(path)
    store.fill(1)
    store.flash.close()
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        # A worn page may tell another schema, which its rows then obey.
        db.execute("PRAGMA writable_schema = ON")
        db.execute(
            "UPDATE sqlite_master SET sql = replace(sql, 'kind INTEGER NOT NULL', 'kind INTEGER')"
        )
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        assert db.execute("UPDATE message SET kind = NULL").rowcount == 1
    flash = open_flash(path)
    with pytest.raises(FlashError, match="damaged: a record is of other types"):
        flash.after((-1, -1), 10)
    flash.close()


def test_parquet_of_a_kind_that_is_not_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise pa.ArrowNotImplementedError("Integers with more than 64 bits not implemented")

    monkeypatch.setattr(pq, "ParquetFile", refuse)
    with pytest.raises(RecordingError, match="more than 64 bits"):
        list(read_rows(tmp_path / "recording.parquet"))


def test_endless_columns_that_stand_twice_are_shortened(tmp_path: Path) -> None:
    path, name = tmp_path / "recording.csv", "9" * 5000
    path.write_text(f"time,channel,value,{name},{name}\n0,c,1,1,1\n")
    with pytest.raises(RecordingError, match="stand twice") as error:
        list(read_rows(path))
    assert len(str(error.value)) < 500


def test_reason_of_a_rejected_setting_is_short(tmp_path: Path) -> None:
    path = tmp_path / "node.toml"
    text = NODE + Profile.read("hand").text
    path.write_text(text.replace('hygrometer = "a02"', f'hygrometer = "a{"9" * 9000}"', 1))
    with pytest.raises(SettingsError) as caught:
        NodeSettings.load(path)
    assert len(str(caught.value)) < 2000


def test_least_integer_is_no_offset_of_a_frame() -> None:
    """Its size is no integer of 64 bits; the compiled reader took it."""
    check_frame(
        bytes.fromhex(
            "a9010102030311045820868ec9aec7f85e03e778862415b4f6de75fce9bb456b9f2f33ab8d3e1696"
            "6c530500061ab2d05e0007821b18d75b84d6c35e001b18d75b84d6c36da00881851a007a12001a01"
            "312d00189601fb3feff7ced916872b09818701000001263b7fffffffffffffff430008a6"
        )
    )
