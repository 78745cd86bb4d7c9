"""Frames and statements are kept once their layout is, and asked for until then."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cbor2
import numpy as np
import pytest
from eskin_gateway.ingest.missing_layouts import MOST_LAYOUTS
from eskin_gateway.spool.descriptions import Descriptions
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.identity import IdentityKind
from eskin.interval import Verdict
from eskin.privacy import Decryptor, SealedMessage
from eskin.wire.envelope import Opener
from eskin.wire.frames import (
    Because,
    DescribedLayout,
    EncodedFrame,
    Layout,
    MonitorVerdict,
    content_hash,
)
from eskin.wire.messages import Acknowledgement, Kind
from eskin.wire.messages.cbor_map import dump
from eskin.wire.topics import PUBLIC, Stream, live_topic, node_topic
from tests.unit.gateway.in_memory import LAYOUT_WAIT_S, Inside
from tests.unit.gateway.messages import result, status
from tests.unit.gateway.skins import LARGE, MIXED, SMALL, TOUCHED, SkinOf, patch
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.wire.frames import Frame, Statements
    from tests.support.identities import Identities

ACKS = node_topic("fingertip", Stream.ACKS)


class Node:
    """The node ``fingertip``, or another one, at a gateway's inside."""

    def __init__(self, inside: Inside, identities: Identities, name: str = "fingertip") -> None:
        own = identities.node if name == "fingertip" else identities.make(IdentityKind.NODE, name)
        self.name = name
        self._inside = inside
        self._seal = Seal(own, identities.site)
        site = identities.site.certificate
        self._opener = Opener([own], sender=lambda _: site)
        self.send(Stream.STATUS, status(0).encode(), introduce=True)

    def send(self, stream: Stream, plaintext: bytes, *, introduce: bool = False) -> None:
        envelope = self._seal(self.name, stream, plaintext, introduce=introduce)
        self._inside.arrive(stream, envelope, node=self.name)

    def describe(self, skin: SkinOf) -> None:
        for each in skin.descriptions:
            self.send(Stream.LAYOUTS, each)

    def say(self, message: Frame | Statements) -> None:
        stream = Stream.EVENTS if hasattr(message, "peaks") else Stream.FRAMES
        self.send(stream, message.encode())

    @property
    def answers(self) -> list[Acknowledgement]:
        topic = node_topic(self.name, Stream.ACKS)
        sealed = self._inside.broker.on(topic)
        return [
            Acknowledgement.decode(self._opener.open(each, topic=topic).plaintext)
            for each in sealed
        ]

    @property
    def acknowledged(self) -> set[int]:
        """Sequences."""
        spans = [span for answer in self.answers for span in answer.spans]
        return {number for _, first, last in spans for number in range(first, last + 1)}

    @property
    def wanted(self) -> list[tuple[bytes, ...]]:
        return [answer.want for answer in self.answers if answer.want]


@pytest.fixture
def node(inside: Inside, identities: Identities) -> Node:
    return Node(inside, identities)


def bodies(inside: Inside) -> list[bytes]:
    return [body for body in inside.stored() if body != status(0).encode()]


def test_described_frame_and_statements_are_stored_and_acknowledged(
    inside: Inside, node: Node
) -> None:
    node.describe(SMALL)
    node.say(SMALL.frame(1))
    node.say(SMALL.statements(2))
    assert bodies(inside) == [SMALL.frame(1).encode(), SMALL.statements(2).encode()]
    assert node.acknowledged == {0, 1, 2}
    assert node.wanted == []
    assert inside.rejected() == {}
    node.say(SMALL.frame(1))
    assert len(bodies(inside)) == 2
    assert inside.metrics.value("messages_duplicate_total") == 1


def test_frame_of_a_node_that_runs_for_years_is_stored(inside: Inside, node: Node) -> None:
    node.describe(SMALL)
    old = replace(SMALL.frame(1), ticks=400 * 86_400 * 10**9)
    node.say(old)
    assert bodies(inside) == [old.encode()]
    assert inside.rejected() == {}


@pytest.mark.parametrize("message", [SMALL.frame(1), SMALL.statements(1)])
def test_gateway_asks_for_a_layout_and_then_for_its_patches(
    inside: Inside, node: Node, message: Frame | Statements
) -> None:
    node.say(message)
    assert node.wanted == [(SMALL.layout.content_hash,)]
    assert node.acknowledged == {0}
    assert inside.broker.released == [1, 2], "the broker may forget it; the node has it"
    node.send(Stream.LAYOUTS, SMALL.layout.encode())
    inside.clock.seconds += 1.5
    node.say(message)
    assert node.wanted[1:] == [SMALL.layout.patches]
    for each in SMALL.patches:
        node.send(Stream.LAYOUTS, each.encode())
    assert bodies(inside) == []
    node.say(message)
    assert bodies(inside) == [message.encode()]
    assert node.acknowledged == {0, 1}
    assert inside.metrics.value("messages_waiting_total") == 2
    assert inside.rejected() == {}


def test_many_waiting_frames_ask_once_a_second(inside: Inside, node: Node) -> None:
    for number in range(1, 20):
        node.say(SMALL.frame(number))
        inside.clock.seconds += 0.1
    assert len(node.wanted) == 2


def test_layout_of_many_patches_is_asked_for_in_parts(inside: Inside, node: Node) -> None:
    skin = SkinOf(*(patch(number, 1) for number in range(300)))
    node.send(Stream.LAYOUTS, skin.layout.encode())
    node.say(skin.frame(1, rows=1))
    (first,) = node.wanted
    assert first == skin.layout.patches[:256]
    for each in skin.patches[:256]:
        node.send(Stream.LAYOUTS, each.encode())
    inside.clock.seconds += 1.5
    node.say(skin.frame(1, rows=1))
    assert node.wanted[1] == skin.layout.patches[256:]


def test_frames_wait_for_their_layout_for_a_limited_time(
    inside: Inside, node: Node, identities: Identities
) -> None:
    other = Node(inside, identities, "palm")
    other.describe(LARGE)
    waited = 0.0
    while waited < LAYOUT_WAIT_S:
        assert inside.spool.dead_letters() == []
        node.say(SMALL.frame(1))
        other.say(LARGE.frame(int(waited) + 1))
        inside.clock.seconds += 30.0
        waited += 30.0
    assert len(other.acknowledged) == 1 + 20, "no other node waits"
    node.say(SMALL.frame(1))
    (letter,) = inside.spool.dead_letters()
    assert (letter.node, letter.body) == ("fingertip", b"")
    assert SMALL.layout.content_hash.hex() in letter.reason
    assert "sequence 1" in letter.reason
    assert node.acknowledged == {0, 1}, "the node may forget it"
    node.say(SMALL.frame(2))
    assert len(inside.spool.dead_letters()) == 2
    node.describe(SMALL)
    node.say(SMALL.frame(3))
    assert bodies(inside)[-1] == SMALL.frame(3).encode()


def test_time_of_waiting_begins_anew_when_a_node_was_away(inside: Inside, node: Node) -> None:
    node.say(SMALL.frame(1))
    inside.clock.seconds += LAYOUT_WAIT_S + 100.0
    node.say(SMALL.frame(1))
    assert inside.spool.dead_letters() == []
    assert len(node.wanted) == 2


def test_node_that_names_many_layouts_makes_dead_letters(inside: Inside, node: Node) -> None:
    """A node with frames of ever other layouts takes bounded memory."""
    for number in range(1, MOST_LAYOUTS + 5):
        node.say(replace(SMALL.frame(number), layout=bytes([number]) * 32))
    assert len(inside.spool.dead_letters()) == 4
    assert node.acknowledged == {0, *range(MOST_LAYOUTS + 1, MOST_LAYOUTS + 5)}


def test_layout_of_another_node_counts_for_that_node_alone(
    inside: Inside, node: Node, identities: Identities
) -> None:
    node.describe(SMALL)
    other = Node(inside, identities, "palm")
    other.say(SMALL.frame(1))
    assert other.wanted == [(SMALL.layout.content_hash,)]
    assert bodies(inside) == []


WIDER = SkinOf(patch(0, 4), patch(1, 2))
UNFIT: dict[str, Frame | Statements] = {
    "columns": replace(WIDER.frame(1), layout=SMALL.layout.content_hash),
    "page": replace(LARGE.frame(1, page=1), layout=SMALL.layout.content_hash),
    "epoch": replace(
        SMALL.frame(1), patches=tuple(replace(each, epoch=1) for each in SMALL.frame(1).patches)
    ),
    "patch": replace(
        SMALL.statements(1), peaks=(SMALL.statements(1).peaks[0]._replace(patch=2),), gaps=()
    ),
    "column": replace(
        SMALL.statements(1), peaks=(SMALL.statements(1).peaks[0]._replace(column=3),)
    ),
    "gap": replace(SMALL.statements(1), gaps=(SMALL.statements(1).gaps[0]._replace(patches=(9,)),)),
}


@pytest.mark.parametrize("what", UNFIT)
def test_message_that_does_not_fit_its_layout_is_a_dead_letter(
    inside: Inside, node: Node, what: str
) -> None:
    node.describe(SMALL)
    for _ in range(2):
        node.say(UNFIT[what])
    (letter,) = inside.spool.dead_letters()
    assert letter.body == UNFIT[what].encode(), "no patch is biometric"
    assert letter.reason
    assert bodies(inside) == []
    assert node.acknowledged == {0, 1}
    node.say(SMALL.frame(2))
    assert bodies(inside) == [SMALL.frame(2).encode()]


def test_layout_may_change_in_mid_boot(inside: Inside, node: Node) -> None:
    """Frames of the new layout wait at the node, and hold up none of the old one."""
    node.describe(SMALL)
    old = SMALL.frame(1), SMALL.frame(3)
    new = WIDER.frame(2), WIDER.statements(4), WIDER.frame(5)
    said = (old[0], new[0], old[1], new[1], new[2])
    for each in said:
        node.say(each)
    assert bodies(inside) == [each.encode() for each in old]
    assert node.acknowledged == {0, 1, 3}
    assert node.wanted[0] == (WIDER.layout.content_hash,)
    node.describe(WIDER)
    for each in said:
        node.say(each)
    assert sorted(bodies(inside)) == sorted(each.encode() for each in said)
    assert node.acknowledged == {0, 1, 2, 3, 4, 5}
    assert inside.rejected() == {}


@pytest.mark.parametrize("rows", [1, 3])
def test_frame_torn_at_any_byte_is_a_dead_letter(inside: Inside, node: Node, rows: int) -> None:
    node.describe(SMALL)
    whole = SMALL.frame(1, rows=rows).encode()
    for length in range(len(whole)):
        node.send(Stream.FRAMES, whole[:length])
    assert sum(inside.rejected().values()) == len(whole)
    assert all(letter.reason for letter in inside.spool.dead_letters())
    assert bodies(inside) == []
    assert node.acknowledged == {0}
    node.say(SMALL.frame(1, rows=rows))
    assert bodies(inside) == [whole]


def test_layout_that_contradicts_its_patches_makes_dead_letters(inside: Inside, node: Node) -> None:
    one_page = SkinOf(*MIXED.patches)  # a page of two privacy classes
    node.describe(one_page)
    node.say(replace(SMALL.frame(1), layout=one_page.layout.content_hash))
    (letter,) = inside.spool.dead_letters()
    assert letter.body == b""
    assert "privacy" in letter.reason


def test_patch_named_as_a_layout_makes_dead_letters(inside: Inside, node: Node) -> None:
    node.describe(SMALL)
    node.say(replace(SMALL.frame(1), layout=SMALL.layout.patches[0]))
    assert len(inside.spool.dead_letters()) == 1
    assert node.acknowledged == {0, 1}


@pytest.mark.parametrize("message", [MIXED.frame(1, page=1), MIXED.peaks(1, number=1)])
def test_biometric_message_is_stored_sealed_and_not_published(
    inside: Inside, node: Node, message: Frame | Statements, tmp_path: Path
) -> None:
    node.describe(MIXED)
    for _ in range(2):
        node.say(message)
    (sealed,) = bodies(inside)
    found = SealedMessage.decode(sealed)
    assert Decryptor(inside.keystore).read("fingertip", found)[1] == message.encode()
    assert found.subject == inside.assignments.subject("fingertip", found.time[0]).pseudonym
    assert found.layout == MIXED.layout.content_hash
    assert node.acknowledged == {0, 1}
    written = b"".join(file.read_bytes() for file in tmp_path.glob("spool.db*"))
    assert message.encode()[-40:] not in written
    inside.clock.seconds += 10.0
    inside.post_commit.run_periodic()
    assert not public(inside)
    node.say(MIXED.frame(2))
    assert bodies(inside)[1:] == [MIXED.frame(2).encode()], "its public page is public"
    assert public(inside)


def public(inside: Inside) -> list[str]:
    """Public topics besides the node's status."""
    topics = [topic for topic, *_ in inside.broker.published]
    status_topic = live_topic("fingertip", "status")
    return [each for each in topics if each.startswith(PUBLIC) and each != status_topic]


@pytest.mark.parametrize(
    ("skin", "message"),
    [
        (MIXED, MIXED.statements(1, number=1)),
        (MIXED, replace(MIXED.statements(1, number=1), contacts=())),
        (MIXED, replace(MIXED.statements(1, number=1), gaps=())),
        (TOUCHED, TOUCHED.statements(1)),
        (MIXED, replace(
            MIXED.peaks(1),
            verdicts=(MonitorVerdict("grip", (0, 1), Verdict.CERTAIN, final=True,
                                     because=Because(0), coverage=1.0),),
        )),
        (MIXED, replace(MIXED.frame(1, page=1), page=0)),
    ],
)  # fmt: skip
def test_message_of_two_privacy_classes_is_refused_and_kept_nowhere(
    inside: Inside, node: Node, skin: SkinOf, message: Frame | Statements, tmp_path: Path
) -> None:
    node.describe(skin)
    node.say(message)
    (letter,) = inside.spool.dead_letters()
    assert letter.body == b""
    assert bodies(inside) == []
    assert node.acknowledged == {0, 1}
    written = b"".join(file.read_bytes() for file in tmp_path.glob("spool.db*"))
    assert message.encode()[-40:] not in written


def test_contacts_of_public_patches_are_public_beside_biometric_ones(
    inside: Inside, node: Node
) -> None:
    node.describe(MIXED)
    node.say(MIXED.statements(1))
    assert bodies(inside) == [MIXED.statements(1).encode()]


@pytest.mark.parametrize(
    "change", [{8: "adalbert"}, {7: 0}, {3: "voltage"}], ids=["name", "public", "other quantity"]
)
def test_description_that_names_a_person_or_contradicts_itself_is_kept_nowhere(
    inside: Inside, node: Node, change: dict[int, object], tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    fields = cbor2.loads(MIXED.patches[1].encode()) | {2: "skin-of-xyz"} | change
    if change == {7: 0}:
        del fields[8]
    said = dump(fields)
    node.send(Stream.LAYOUTS, said)
    assert inside.rejected() == {"unreadable": 1}
    assert inside.spool.description_sizes("fingertip") == {}
    written = b"".join(file.read_bytes() for file in tmp_path.glob("spool.db*"))
    assert said not in written
    assert b"skin-of-xyz" not in written
    assert "adalbert" not in caplog.text


def test_frame_on_another_stream_is_a_dead_letter(inside: Inside, node: Node) -> None:
    node.describe(SMALL)
    node.send(Stream.EVENTS, SMALL.frame(1).encode())
    node.send(Stream.FRAMES, SMALL.statements(2).encode())
    node.send(Stream.FRAMES, result(3, 1).encode())
    node.send(Stream.LAYOUTS, SMALL.frame(4).encode())
    assert len(inside.spool.dead_letters()) == 4
    assert node.acknowledged == {0, 1, 2, 3, 4}
    assert bodies(inside) == []


def test_description_in_another_encoding_is_a_dead_letter(inside: Inside, node: Node) -> None:
    node.send(Stream.LAYOUTS, SMALL.layout.encode() + b"\x00")
    node.send(Stream.LAYOUTS, dump({1: int(Kind.LAYOUT), 2: b"short", 3: [1]}))
    assert len(inside.spool.dead_letters()) == 2
    assert inside.rejected() == {"unreadable": 2}


def test_descriptions_outlive_a_restart(
    inside: Inside, node: Node, identities: Identities, tmp_path: Path
) -> None:
    node.describe(SMALL)
    node.say(SMALL.frame(1))
    inside.spool.close()
    later = Inside(tmp_path, identities)
    again = Node(later, identities)
    again.say(SMALL.frame(2))
    assert bodies(later) == [SMALL.frame(1).encode(), SMALL.frame(2).encode()]
    assert again.wanted == []
    later.spool.close()


def test_descriptions_of_a_batch_that_was_not_committed_are_asked_for_again(
    inside: Inside, node: Node
) -> None:
    seal = node._seal
    received = [
        inside.received_message(Stream.LAYOUTS, seal("fingertip", Stream.LAYOUTS, each))
        for each in SMALL.descriptions
    ]
    inside.validator.validate(received)
    inside.validator.reset()  # as after a failed commit
    node.say(SMALL.frame(1))
    assert node.wanted == [(SMALL.layout.content_hash,)]
    assert bodies(inside) == []


def test_damaged_description_is_asked_for_again(
    inside: Inside, node: Node, identities: Identities, tmp_path: Path
) -> None:
    node.describe(SMALL)
    inside.spool._ingest.execute("UPDATE descriptions SET body = x'00' WHERE rowid = 1")
    inside.spool.close()
    later = Inside(tmp_path, identities)
    again = Node(later, identities)
    again.say(SMALL.frame(1))
    assert again.wanted == [(SMALL.layout.patches[0],)]
    again.describe(SMALL)
    again.say(SMALL.frame(1))
    assert bodies(later) == [SMALL.frame(1).encode()]
    later.spool.close()


def test_oldest_unneeded_descriptions_are_evicted(inside: Inside, node: Node) -> None:
    """10,000 layouts of a node are bounded, and evict none that a spooled frame needs."""
    node.describe(SMALL)
    node.say(SMALL.frame(1))
    small = Descriptions(inside.spool, most=100)
    inside.validator._descriptions = small
    flood = [Layout((content_hash(b"%d" % number),), (1,)).encode() for number in range(10_000)]
    seal = node._seal
    for begin in range(0, len(flood), 500):
        inside.commit_loop.process(
            [
                inside.received_message(Stream.LAYOUTS, seal("fingertip", Stream.LAYOUTS, each))
                for each in flood[begin : begin + 500]
            ]
        )
    kept = inside.spool.description_sizes("fingertip")
    assert set(SMALL.hashes) <= set(kept)
    assert content_hash(flood[-1]) in kept
    assert len(kept) <= 100
    assert inside.rejected() == {}
    node.say(SMALL.frame(2))
    assert bodies(inside)[-1] == SMALL.frame(2).encode()
    # Once the cloud has its frames, nothing needs the layout.
    stored = inside.spool.take(100, 10**9)
    inside.spool.settle(stored)
    for each in flood[:200]:
        node.send(Stream.LAYOUTS, each)
    assert not set(SMALL.hashes) & set(inside.spool.description_sizes("fingertip"))
    inside.clock.seconds += 2.0
    node.say(SMALL.frame(3))
    assert node.wanted == [(SMALL.layout.content_hash,)]


def test_description_for_which_nothing_can_be_evicted_is_rejected(
    inside: Inside, node: Node
) -> None:
    node.describe(SMALL)
    node.say(SMALL.frame(1))
    inside.validator._descriptions = Descriptions(inside.spool, most=3)
    node.send(Stream.LAYOUTS, LARGE.layout.encode())
    assert inside.rejected() == {"too_many_descriptions": 1}
    node.say(SMALL.frame(2))
    assert bodies(inside)[-1] == SMALL.frame(2).encode()


def test_node_with_bytes_beyond_its_limit_keeps_what_is_needed(inside: Inside, node: Node) -> None:
    node.describe(SMALL)
    node.say(SMALL.frame(1))
    used = sum(len(each) for each in SMALL.descriptions)
    inside.validator._descriptions = Descriptions(inside.spool, most_bytes=used + 300)
    for number in range(50):
        node.send(Stream.LAYOUTS, patch(number, 5).encode())
    kept = inside.spool.description_sizes("fingertip")
    assert set(SMALL.hashes) <= set(kept)
    assert sum(kept.values()) <= used + 300


def test_skin_is_joined_as_its_parts_say(inside: Inside, node: Node) -> None:
    node.describe(LARGE)
    found = Descriptions(inside.spool).find("fingertip", LARGE.layout.content_hash)
    assert isinstance(found, DescribedLayout)
    assert (found.layout, found.patches, found.channels) == (LARGE.layout, LARGE.patches, 80)


SKINS = (
    SMALL,
    LARGE,
    WIDER,
    SkinOf(replace(SMALL.patches[0], alpha=((1.0, 1.1),), beta=((0.0, 1.0),))),
)


@given(
    of=st.sampled_from(SKINS), to=st.sampled_from(SKINS), page=st.integers(0, 2),
    epoch=st.integers(0, 1), last=st.booleans(),
)  # fmt: skip
def test_frame_is_taken_if_and_only_if_it_fits(
    of: SkinOf, to: SkinOf, page: int, epoch: int, *, last: bool
) -> None:
    whole = of.frame(1, page=len(of.layout.pages) - 1 if last else 0)
    samples = tuple(replace(each, epoch=epoch) for each in whole.patches)
    frame = replace(whole, page=page, layout=to.layout.content_hash, patches=samples)
    try:
        frame.require_layout(to.layout, to.patches)
        fits = True
    except (MessageError, IndexError):
        fits = False
    try:
        DescribedLayout.of(to.layout, to.patches).require_frame(EncodedFrame.decode(frame.encode()))
        taken = True
    except MessageError:
        taken = False
    assert taken is fits


def test_frame_of_too_many_channels_is_a_dead_letter(inside: Inside, node: Node) -> None:
    """A frame whose samples could exceed 64 KiB is rejected, however few bytes it has."""
    huge = SkinOf(*(patch(number, 64) for number in range(20)))
    node.describe(huge)
    whole = huge.frame(1, rows=5).encode()
    rows = whole.index(b"\x85\x00\x1a\x01\x31\x2d\x00\x05\x05") + 8
    node.send(Stream.FRAMES, whole[:rows] + b"\x18\xc8" + whole[rows + 1 :])
    assert len(inside.spool.dead_letters()) == 1
    assert np.sum([len(body) for body in bodies(inside)]) == 0
    node.say(huge.frame(2))
    assert bodies(inside) == [huge.frame(2).encode()]
