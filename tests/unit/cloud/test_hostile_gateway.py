"""A gateway that is genuinely enrolled for another site can do nothing to this one."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.jobs.retention import sweep
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.sealed_tables import erased_subjects, sealed_messages, subject_nodes
from eskin_cloud.store.schema.tables import commands, dead_letters, sequences
from sqlalchemy import func, select

from eskin.identity import CertificateAuthority, IdentityKind, der, new_key
from tests.support.identities import SITE
from tests.unit.cloud.clouds import batch, problem
from tests.unit.cloud.messages import START, stretch
from tests.unit.cloud.orders import order
from tests.unit.cloud.sealing import Site, ask, beat, declared, physician, pulse, sealing

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation
    from sqlalchemy import Table

    from eskin.identity import Identity
    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
OTHER = "site.other"
NODE = "hand"


def chain(own: Identity) -> list[bytes]:
    return [der(part) for part in own.chain]


async def post(stand: Stand, path: str, said: Any) -> Any:
    async with stand.ingest_client() as client:
        answer = await client.post(f"/api/v1/{path}", content=cbor2.dumps(said))
    assert answer.status_code == 200, answer.text
    kind = answer.headers["content-type"]
    return cbor2.loads(answer.content) if kind == "application/cbor" else answer.json()["items"]


async def bring(stand: Stand, body: bytes) -> list[str]:
    stand.present(body)
    async with stand.ingest_client() as client:
        answer = await client.post("/api/v1/ingest", content=body)
    assert answer.status_code == 200, answer.text
    return [item["result"] for item in answer.json()["items"]]


def count(stand: Stand, table: Table) -> int:
    with stand.cloud.store.read() as connection:
        return int(connection.execute(select(func.count()).select_from(table)).scalar_one())


class Scene:
    """A cloud with two sites: ours, with a node and a person, and that of the hostile gateway."""

    def __init__(self, stand: Stand, site: Site, identities: Identities) -> None:
        self.stand = stand
        self.site = site
        self.node = identities.make(IdentityKind.NODE, NODE)
        other = identities.make(IdentityKind.GATEWAY, "gateway.other", site=OTHER)
        self.theirs = identities.make(IdentityKind.NODE, "theirs", site=OTHER)
        self.hostile = replace(stand, gateway=other)

    async def begin(self) -> None:
        """Ours brings a node and a person's heart; the other one its own node."""
        assert await post(self.stand, "certificates", [chain(self.node)]) == [
            {"node": NODE, "reason": None}
        ]
        body = self.site.batch(declared(), *(pulse(n) for n in range(1, 6)), beat(6))
        assert set(await bring(self.stand, body)) == {"stored"}
        worn = [[self.site.ada.pseudonym, NODE, self.site.ada.key]]
        stated = await post(self.stand, "subjects", {"worn": worn, "erased": []})
        assert [item["result"] for item in stated] == ["kept"]
        await post(self.hostile, "certificates", [chain(self.theirs)])


@pytest.fixture
def scene(tmp_path: Path, identities: Identities, place: StoreLocation) -> Iterator[Scene]:
    site = Site(tmp_path)
    with sealing(tmp_path / "cloud", identities, place=place) as stand:
        yield Scene(stand, site, identities)


async def test_it_cannot_erase_another_site_s_subject(scene: Scene) -> None:
    await scene.begin()
    stand, ada = scene.stand, scene.site.ada
    before = count(stand, sealed_messages)
    await post(scene.hostile, "subjects", {"worn": [], "erased": [ada.pseudonym]})
    await sweep(stand.cloud)
    assert count(stand, sealed_messages) == before == 6
    assert stand.cloud.key_access.of(SITE).find(ada.pseudonym).key == ada.key
    with stand.cloud.store.read() as connection:
        rows = connection.execute(select(erased_subjects.c.site)).scalars().all()
    assert rows == [OTHER]
    answer = await ask(stand, physician(stand), f"/api/v1/subjects/{ada.pseudonym}/export")
    assert answer.status_code == 200
    assert len(answer.text.splitlines()) == 6
    # Ours can.
    stated = await post(stand, "subjects", {"worn": [], "erased": [ada.pseudonym]})
    assert [item["result"] for item in stated] == ["erased"]
    await sweep(stand.cloud)
    assert count(stand, sealed_messages) == 0


async def test_it_cannot_plant_a_key(scene: Scene) -> None:
    stand, ada = scene.stand, scene.site.ada
    await post(scene.hostile, "certificates", [chain(scene.theirs)])
    for node in (NODE, "theirs"):
        worn = [[ada.pseudonym, node, b"\x55" * 32]]
        stated = await post(scene.hostile, "subjects", {"worn": worn, "erased": []})
        assert [item["result"] for item in stated] == [
            "kept" if node == "theirs" else "unknown_node"
        ]
    await scene.begin()
    assert stand.cloud.key_access.of(SITE).find(ada.pseudonym).key == ada.key
    answer = await ask(stand, physician(stand), f"/api/v1/subjects/{ada.pseudonym}/export")
    assert answer.status_code == 422  # two sites have that name now
    url = f"/api/v1/subjects/{ada.pseudonym}/export"
    answer = await ask(stand, physician(stand), url, site=SITE)
    assert len(answer.text.splitlines()) == 6
    with stand.cloud.store.read() as connection:
        nodes = connection.execute(select(subject_nodes.c.node)).scalars().all()
    assert sorted(nodes) == [NODE, "theirs"]


async def test_differing_key_of_one_site_is_a_conflict_and_the_kept_one_stays(scene: Scene) -> None:
    await scene.begin()
    stand, ada = scene.stand, scene.site.ada
    before = stand.cloud.metrics.conflicts._value.get()
    stated = await post(
        stand, "subjects", {"worn": [[ada.pseudonym, NODE, b"\x55" * 32]], "erased": []}
    )
    assert [item["result"] for item in stated] == ["conflict"]
    assert stand.cloud.key_access.of(SITE).find(ada.pseudonym).key == ada.key
    assert stand.cloud.metrics.conflicts._value.get() == before + 1


async def test_it_cannot_take_another_node_s_numbers_before_or_after_it_is_known(
    scene: Scene,
) -> None:
    stand = scene.stand
    forged = batch(*(stretch(n, [9.0], [9.5]) for n in range(100, 125)), node=NODE)
    for known in (False, True):
        assert set(await bring(scene.hostile, forged)) == {"unknown_node"}
        rubbish = cbor2.dumps([[NODE, b"\xff\xff"]])
        assert await bring(scene.hostile, rubbish) == ["unknown_node"]
        if not known:
            await scene.begin()
    assert count(stand, dead_letters) == count(stand, frames) == 0
    with stand.cloud.store.read() as connection:
        spans = connection.execute(select(sequences.c.first, sequences.c.last)).all()
    assert [tuple(span) for span in spans] == [(0, 6)]
    genuine = batch(*(stretch(n) for n in range(100, 125)), node=NODE)
    assert set(await bring(stand, genuine)) == {"stored"}
    assert count(stand, frames) == 25


async def test_it_cannot_have_another_site_s_node_known_as_its_own(
    scene: Scene, identities: Identities, tmp_path: Path
) -> None:
    outsider = CertificateAuthority.open(tmp_path / "outsider")
    key = new_key()
    forged = outsider.issue(IdentityKind.NODE, NODE, key.public_key(), site=OTHER)
    site = identities.make(IdentityKind.SITE, "site.of-none")
    lies = [
        chain(scene.node),  # genuine, and of our site
        [der(part) for part in forged],
        [der(forged[0]), der(scene.theirs.chain[1])],
        chain(scene.hostile.gateway),  # type: ignore[arg-type]  # it has one
        chain(site),
        [b"", b""],
    ]
    stated = await post(scene.hostile, "certificates", lies)
    assert all(item["reason"] for item in stated)
    await scene.begin()
    again = await post(scene.hostile, "certificates", [chain(scene.node)])
    assert again[0]["reason"]
    assert await bring(scene.stand, batch(stretch(50), node=NODE)) == ["stored"]


async def test_it_is_given_no_command_of_another_site_and_cannot_answer_it(scene: Scene) -> None:
    await scene.begin()
    stand = scene.stand
    accepted = await order(stand, {"name": "set", "arguments": {"rate": 500}}, node=NODE)
    assert accepted.status_code == 202, accepted.text
    number = accepted.json()["id"]
    asked = {"held": [], "wait_s": 0.0, "published": None}
    assert (await post(scene.hostile, "deliveries", asked))["give"] == []
    lied = {"held": [[NODE, number, True]], "wait_s": 0.0, "published": None}
    assert (await post(scene.hostile, "deliveries", lied))["drop"] == [[NODE, number]]
    with stand.cloud.store.read() as connection:
        assert connection.execute(select(commands.c.delivered)).scalar_one() is None
    given = (await post(stand, "deliveries", asked))["give"]
    assert [(node, each) for node, each, _ in given] == [(NODE, number)]


async def test_what_waited_is_stored_once_the_certificate_is_presented_also_an_expired_one(
    scene: Scene, identities: Identities
) -> None:
    long_ago = datetime.now(UTC) - timedelta(days=200)
    old = identities.make(IdentityKind.NODE, "sleeper", now=long_ago, lifetime=timedelta(days=1))
    body = batch(*(stretch(n) for n in range(5)), node="sleeper")
    assert set(await bring(scene.stand, body)) == {"unknown_node"}
    stated = await post(scene.stand, "certificates", [chain(old)])
    assert stated == [{"node": "sleeper", "reason": None}]
    assert set(await bring(scene.stand, body)) == {"stored"}


@pytest.mark.parametrize("said", [[], {}, 5, [[b"x"]], [[b"x", "y"]], [b"x"], [[b"", b"", b""]]])
async def test_presented_rubbish_is_refused(scene: Scene, said: Any) -> None:
    async with scene.stand.ingest_client() as client:
        answer = await client.post("/api/v1/certificates", content=cbor2.dumps(said))
    if said == []:
        assert answer.json() == {"items": []}
    elif answer.status_code == 200:
        assert all(item["reason"] for item in answer.json()["items"])
    else:
        assert problem(answer, 422)


async def test_sites_are_shown(scene: Scene) -> None:
    await scene.begin()
    found = (await scene.stand.get("/api/v1/gateways")).json()["items"]
    assert {item["id"]: item["site"] for item in found} == {"gateway.g1": SITE}
    assert START > 0
