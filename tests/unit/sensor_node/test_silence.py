"""When a node gives up a connection that carries no answers."""

from __future__ import annotations

from eskin_sensor_node.link.publisher import ReconnectTimer


def test_silence_counts_from_the_connection_and_from_each_answer() -> None:
    silence = ReconnectTimer(10.0)
    assert not silence.is_too_long(1e9, waiting=True)
    silence.connected(100.0)
    assert not silence.is_too_long(109.9, waiting=True)
    silence.answered(109.9)
    assert not silence.is_too_long(119.8, waiting=True)
    assert silence.is_too_long(119.9, waiting=True)
    # Asked once: the connection ends now.
    assert not silence.is_too_long(1e9, waiting=True)


def test_who_waits_for_nothing_is_patient() -> None:
    silence = ReconnectTimer(10.0)
    silence.connected(100.0)
    assert not silence.is_too_long(200.0, waiting=False)
    assert not silence.is_too_long(209.9, waiting=True)
    assert silence.is_too_long(210.0, waiting=True)


def test_patience_doubles_up_to_a_limit_and_an_answer_restores_it() -> None:
    silence = ReconnectTimer(1.0)
    now, waits = 0.0, []
    for _ in range(7):
        silence.connected(now)
        start = now
        while not silence.is_too_long(now, waiting=True):
            now += 0.5
        waits.append(now - start)
    assert waits == [1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]
    silence.connected(now)
    silence.answered(now)
    assert silence.is_too_long(now + 1.0, waiting=True)
