"""Which frames a slow client is not sent: whole stretches, and never the newest."""

from __future__ import annotations

from eskin_cloud.live.frame_encoder import PATIENCE_NS, StretchFilter
from eskin_cloud.store.feed_entry import FeedEntry
from hypothesis import given
from hypothesis import strategies as st

NODES = ("hand", "foot")


@given(
    st.lists(
        st.tuples(
            st.sampled_from(NODES),
            st.integers(1, 4),  # pages
            st.integers(0, PATIENCE_NS),  # until the next page is stored
            st.integers(0, 3 * PATIENCE_NS),  # by which the newest is ahead
        ),
        max_size=30,
    )
)
def test_all_pages_of_a_stretch_are_kept_or_none(said: list[tuple[str, int, int, int]]) -> None:
    dropping, kept = StretchFilter(), dict[tuple[str, int], list[bool]]()
    now = cursor = 0
    for number, (node, pages, step, ahead) in enumerate(said):
        for page in range(pages):
            now, cursor = now + step, cursor + 1
            entry = FeedEntry(cursor, node, None, None, now, frame=b"")
            newest = now + ahead
            keeps = dropping.keeps(entry, (1, number), newest)
            if page == 0:
                assert keeps == (ahead <= PATIENCE_NS)
            kept.setdefault((node, number), []).append(keeps)
    assert all(len(set(each)) == 1 for each in kept.values())
