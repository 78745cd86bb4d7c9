"""Topics name a node and a stream, and nothing else passes for one."""

from __future__ import annotations

import pytest

from eskin.errors import MessageError
from eskin.wire.topics import Stream, node_topic, parse_node_topic


@pytest.mark.parametrize("stream", Stream)
def test_topic_comes_back(stream: Stream) -> None:
    assert parse_node_topic(node_topic("finger-tip_1", stream)) == ("finger-tip_1", stream)


@pytest.mark.parametrize(
    "topic",
    [
        "",
        "eskin/v1/nodes/a/blocks/",
        "eskin/v1/nodes/a/secrets",
        "eskin/v1/nodes/a.b/blocks",
        "eskin/v1/nodes/+/blocks",
        "eskin/v1/nodes/A/blocks",
        "eskin/v2/nodes/a/blocks",
        "eskin/v1/nodes//blocks",
        "eskin/v1/nodes/a/blocks\n",
    ],
)
def test_what_is_no_topic_of_a_node_is_refused(topic: str) -> None:
    with pytest.raises(MessageError, match="no topic of a node"):
        parse_node_topic(topic)
