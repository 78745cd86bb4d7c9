"""The check of banned words finds them in prose and in names."""

from __future__ import annotations

from tests.architecture.prose import find


def test_banned_words_are_found_with_their_line() -> None:
    text = "def test_nobody_is_served() -> None:\n    # Whoever asks is told.\n"
    assert find(text) == [(1, "nobody"), (2, "Whoever"), (2, "told")]


def test_words_that_contain_banned_ones_pass() -> None:
    assert find("toldness, strange, Nobodys, heedless, tell") == []
