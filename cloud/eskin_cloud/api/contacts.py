"""The contacts of a node's skin, over time."""

from typing import Annotated, Final

from fastapi import APIRouter, Query
from pydantic import Field
from starlette.responses import Response

from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.window_params import WindowQuery
from eskin_cloud.query.contacts import ContactSkin, find_common_end
from eskin_cloud.schemas.base import PageDocument, page
from eskin_cloud.schemas.contacts import ContactsDocument, describe_contacts
from eskin_cloud.store.descriptions import find_layout, find_shares
from eskin_cloud.store.read.lookup import find_node
from eskin_cloud.store.read.window import parse_window

router = APIRouter(tags=["contacts"])

MOST_POINTS: Final = 100
"""Each instant is read for itself, from all pages of the skin."""


class ContactsQuery(WindowQuery):
    """Parameters of contacts."""

    node: str = Field(max_length=100, description="whose skin")
    points: int = Field(
        default=20,
        ge=1,
        le=MOST_POINTS,
        description="instants: the window's last one, and others evenly before it",
    )


@router.get(
    "/contacts", responses={200: {"model": PageDocument[ContactsDocument]}, **REFUSALS_OF_PLACE}
)
def get_contacts(
    cloud: CloudState, _: Reader, query: Annotated[ContactsQuery, Query()]
) -> Response:
    """Find the contacts of a node's whole skin at instants.

    They are read by the node's latest layout. A sample holds until the next, and before a gap for
    its period; instants at which nothing is known are left out. Biometric patches are not read:
    they may be touched or not.
    """
    found = []
    with cloud.store.read() as connection:
        name = find_node(connection, query.node)["layout"]
        described = None if name is None else find_layout(connection, query.node, name)
        skin = None if described is None else ContactSkin.of(described)
        shares = [] if described is None else find_shares(connection, query.node, described)
        last = find_common_end(connection, shares)
        window = parse_window(query.start, query.end, last=cloud.clock() if last is None else last)
        if described is not None and skin is not None:
            nodes = [share.node for share in shares]
            for number in range(query.points):
                t = window.start + (number + 1) * window.span // query.points - 1
                pressures = skin.read_at(connection, shares, described, t)
                if pressures.known:
                    contacts = skin.find(pressures)
                    found.append(describe_contacts(nodes, skin, pressures, contacts))
    return as_json(page(found, None))
