"""A gateway presents the certificate of a node that was revoked."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.settings import NodesSection

from eskin.identity import IdentityKind, der
from tests.unit.cloud.clouds import batch, count_frames, standing
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from eskin.identity import Identity
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
NAME = "palm"


class Site:
    """A CA, its nodes' revocation list as the cloud has it, and the cloud."""

    def __init__(self, folder: Path, place: StoreLocation) -> None:
        from tests.support.identities import Identities  # noqa: PLC0415 - the class, not the fixture

        self.folder = folder
        self.place = place
        self.identities = Identities(folder / "own")
        self.list = folder / "node.crl.pem"

    def fetch(self) -> None:
        """Have the cloud given the list that stands."""
        written = self.identities.authority.write_revocations(IdentityKind.NODE)
        self.list.write_bytes(written.read_bytes())

    def stand(self) -> Any:
        """The cloud."""
        nodes = NodesSection(revocations=self.list)
        return standing(self.folder, self.identities, place=self.place, nodes=nodes)


@pytest.fixture
def site(tmp_path: Path, place: StoreLocation) -> Site:
    return Site(tmp_path, place)


async def present(stand: Stand, *nodes: Identity) -> list[str | None]:
    """Why each certificate is refused; ``None`` where it is not."""
    chains = [[der(part) for part in node.chain] for node in nodes]
    async with stand.ingest_client() as client:
        answer = await client.post("/api/v1/certificates", content=cbor2.dumps(chains))
    assert answer.status_code == 200
    return [item["reason"] for item in answer.json()["items"]]


async def bring(stand: Stand, *numbers: int) -> list[str]:
    """What becomes of frames of the node."""
    async with stand.ingest_client() as client:
        body = batch(*(stretch(number) for number in numbers), node=NAME)
        stand.present(body)
        answer = await client.post("/api/v1/ingest", content=body)
    return [item["result"] for item in answer.json()["items"]]


async def test_revoked_certificate_makes_no_node_known_and_a_new_one_does(site: Site) -> None:
    lost = site.identities.make(IdentityKind.NODE, NAME)
    other = site.identities.make(IdentityKind.NODE, "hand")
    site.identities.authority.revoke(NAME)
    site.fetch()
    with site.stand() as stand:
        refused, good = await present(stand, lost, other)
        assert refused is not None
        assert good is None
        assert await bring(stand, 0, 1) == ["unknown_node"] * 2
        assert count_frames(stand) == 0
        # The gateway still has them, and the node comes with a new certificate of its name.
        assert await present(stand, site.identities.make(IdentityKind.NODE, NAME)) == [None]
        assert await bring(stand, 0, 1) == ["stored"] * 2


async def test_what_was_acknowledged_before_the_revocation_is_stored_after_it(site: Site) -> None:
    node = site.identities.make(IdentityKind.NODE, NAME)
    site.fetch()
    with site.stand() as stand:
        assert await present(stand, node) == [None]
        assert await bring(stand, 0) == ["stored"]
        site.identities.authority.revoke(NAME)
        site.fetch()
        assert await bring(stand, 1, 2) == ["stored"] * 2
        assert await present(stand, node) != [None]


async def test_without_the_list_that_is_configured_no_node_becomes_known(site: Site) -> None:
    node = site.identities.make(IdentityKind.NODE, NAME)
    with site.stand() as stand:
        assert await present(stand, node) != [None]
        site.fetch()
        assert await present(stand, node) == [None]


async def test_expired_certificate_still_makes_its_node_known(site: Site) -> None:
    site.fetch()
    asleep = site.identities.make(IdentityKind.NODE, NAME, lifetime=timedelta(seconds=-1))
    with site.stand() as stand:
        assert await present(stand, asleep) == [None]
