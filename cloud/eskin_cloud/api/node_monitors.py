"""The monitors that run on a node."""

from typing import Annotated

from fastapi import APIRouter, Query

from eskin.wire.timestamp import SECOND
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.schemas.base import NoQuery, PageDocument
from eskin_cloud.schemas.node_monitors import NodeMonitorDocument, describe_node_monitors
from eskin_cloud.schemas.nodes import judge_health
from eskin_cloud.store.read.lookup import find_node
from eskin_cloud.store.write.commands import find_state
from eskin_cloud.store.write.events import find_verdicts

router = APIRouter(tags=["monitors"])


@router.get("/nodes/{node}/monitors", responses=REFUSALS_OF_PLACE)
def get_node_monitors(
    cloud: CloudState, _: Reader, node: str, query: Annotated[NoQuery, Query()]
) -> PageDocument[NodeMonitorDocument]:
    """List the monitors that run on a node, by name.

    Each with its latest verdict, and the level of its output.
    """
    del query
    with cloud.store.read() as connection:
        row = find_node(connection, node)
        state = find_state(connection, node)
        stated = find_verdicts(connection, node)
    silence = (cloud.clock() - row["last_seen"]) / SECOND
    health = judge_health(cloud.settings.nodes, silence, ahead=-silence)
    found = describe_node_monitors(state, stated, boot=row["boot"], online=health == "online")
    return PageDocument(items=found, next=None)
