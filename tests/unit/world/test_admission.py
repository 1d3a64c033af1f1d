"""If this fails, one address can have a node do nothing but shake hands, or honest ones behind it are kept out."""

from __future__ import annotations

import ssl

import pytest

from scenefold.base.limits import (
    HANDSHAKES_BURST,
    HANDSHAKES_PER_S,
    KNOCKS_BURST,
    KNOCKS_PER_S,
    NEWCOMERS_BURST,
    NEWCOMERS_PER_S,
    PEER_HANDSHAKES_BURST,
    PEER_HANDSHAKES_PER_S,
)
from scenefold.world.real.admission import HELLO_BYTES, PAUSE_S_MAX, Admission, Pauses, begins_tls

OFFICE, ELSEWHERE = "10.0.0.1", "10.0.0.2"


def failed(admission: Admission, attempts: int, now: float) -> int:
    """How many handshakes that lead to nothing an address may begin."""
    return sum(admission.may_shake_hands(OFFICE, now) for _ in range(attempts))


def came_in(admission: Admission, peer: str, attempts: int, now: float) -> int:
    count = 0
    for _ in range(attempts):
        if admission.may_shake_hands(OFFICE, now):
            admission.came_in(OFFICE, peer, now)
            count += 1
    return count


def test_handshakes_that_fail_are_counted_by_address() -> None:
    admission = Admission()
    assert failed(admission, 10 * HANDSHAKES_BURST, 0.0) == HANDSHAKES_BURST
    assert failed(admission, 1_000, 10.0) == min(HANDSHAKES_BURST, 10 * HANDSHAKES_PER_S)
    assert admission.may_shake_hands(ELSEWHERE, 0.0)
    assert not admission.may_knock(OFFICE, 10.0), "it need not come nearer"
    assert admission.may_knock(OFFICE, 11.0) and admission.may_knock(ELSEWHERE, 10.0)


def test_many_peers_behind_one_address_come_in_at_once_and_again() -> None:
    admission = Admission()
    for turn in range(10):
        for number in range(500):
            assert came_in(admission, f"user:{number}", PEER_HANDSHAKES_BURST // 10, turn * 1.0) == PEER_HANDSHAKES_BURST // 10


def test_a_peer_that_comes_again_and_again_uses_up_its_address() -> None:
    admission = Admission()
    assert came_in(admission, "user:pushy", 10_000, 0.0) == PEER_HANDSHAKES_BURST + HANDSHAKES_BURST
    a_second = sum(came_in(admission, "user:pushy", 10, 100 + step / 100) for step in range(10_000)) / 100
    assert a_second < (PEER_HANDSHAKES_PER_S + HANDSHAKES_PER_S) * 1.2


def test_a_crowd_of_connections_is_cut() -> None:
    admission = Admission()
    assert sum(admission.may_knock(OFFICE, 0.0) for _ in range(10 * KNOCKS_BURST)) == KNOCKS_BURST
    assert admission.may_knock(ELSEWHERE, 0.0)


def test_a_crowd_that_comes_in_well_is_not_cut() -> None:
    admission = Admission()
    for number in range(10 * KNOCKS_BURST):
        assert admission.may_knock(OFFICE, 0.0)
        assert came_in(admission, f"user:{number % 500}", 1, 0.0) == 1
    assert sum(admission.may_knock(OFFICE, 0.0) for _ in range(2 * KNOCKS_BURST)) == KNOCKS_BURST
    assert sum(admission.may_knock(OFFICE, 1.0) for _ in range(2 * KNOCKS_BURST)) == KNOCKS_PER_S


def test_while_nearly_all_is_refused_the_queue_is_looked_at_less_and_less_often_but_never_for_long() -> None:
    pauses = Pauses()
    assert pauses.next_s() == 0.0
    found = []
    for _ in range(10):
        for _ in range(9):
            pauses.refused()
        pauses.let_in()
        found.append(pauses.next_s())
    assert found == sorted(found) and 0 < found[0] < found[-1] == PAUSE_S_MAX
    pauses.refused()
    pauses.let_in()
    assert pauses.next_s() == 0.0


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_what_tls_says_first_may_go_on(version: ssl.TLSVersion) -> None:
    context = ssl.create_default_context()
    context.minimum_version = context.maximum_version = version
    outgoing = ssl.MemoryBIO()
    with pytest.raises(ssl.SSLWantReadError):
        context.wrap_bio(ssl.MemoryBIO(), outgoing, server_hostname="127.0.0.1").do_handshake()
    hello = outgoing.read()
    for length in range(1, len(hello)):
        assert begins_tls(hello[:length]), "however little of it has come"
    for index in (0, 1, 5):
        assert not begins_tls(hello[:index] + bytes((hello[index] ^ 64,)) + hello[index + 1 : HELLO_BYTES])


@pytest.mark.parametrize("noise", [b"", b"GET / HTTP/1.0", b"\x00" * 6, b"SSH-2.0", b"\x16\x03\x01\x02\x00\x02"])
def test_other_first_words_are_no_tls(noise: bytes) -> None:
    assert not begins_tls(noise)


def test_newcomers_that_show_no_open_invitation_are_counted_by_address_and_others_are_not() -> None:
    admission = Admission()
    assert sum(admission.may_ask(OFFICE, 0.0) for _ in range(10 * NEWCOMERS_BURST)) == NEWCOMERS_BURST
    assert admission.may_ask(ELSEWHERE, 0.0)
    assert sum(admission.may_ask(OFFICE, 10.0) for _ in range(1_000)) == 10 * NEWCOMERS_PER_S
    for _ in range(10 * NEWCOMERS_BURST):
        assert admission.may_ask(ELSEWHERE, 20.0), "a whole farm may be enrolled from behind one address"
        admission.was_expected(ELSEWHERE, 20.0)
