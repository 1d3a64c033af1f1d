"""If this fails, whoever can send datagrams takes a node's time, or keeps it from hearing its peers."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import SealingPublicKey
from scenefold.peer.datagrams import Drop
from scenefold.peer.datagrams.exchange import (
    OWN_UNKNOWN_SALTS_BURST,
    OWN_UNKNOWN_SALTS_PER_S,
    UNKNOWN_SALTS_BURST,
    UNKNOWN_SALTS_PER_S,
)
from unit.peer.datagrams.four_nodes import ADA, BOB, CAROL, DAVE, boot, introduced, key_of, kinds, reply, said, take


def test_what_comes_from_another_address_than_its_senders_is_dropped_before_any_key() -> None:
    asked = list[NodeId]()

    def known(node: NodeId) -> SealingPublicKey | None:
        asked.append(node)
        return key_of(node)

    ada, bob = boot(ADA), boot(BOB, known=known)
    for source in (address_of(CAROL), address_of(BOB), "127.0.0.1", ""):
        sender, taken = bob.take(said(ada, BOB, b"hello"), source, 0.0)
        assert sender is None and not taken.packets and not taken.replies
        assert kinds(taken) == [Drop.ELSEWHERE]
    assert not asked
    assert take(bob, said(ada, BOB, b"hello")).replies


def forgeries(count: int, sender: NodeId = ADA) -> list[bytes]:
    """From the sender's own address, as somebody in between can send them; each under a salt of its own."""
    dice, head = random.Random(f"{sender} {count}"), said(boot(sender), BOB, b"hello")[:12]
    return [head + dice.randbytes(16) + bytes(8) + dice.randbytes(60) for _ in range(count)]


def test_only_so_many_are_opened_under_salts_that_do_not_count() -> None:
    bob, per_s, seconds = boot(BOB), 10_000, 2
    of_each = zip(forgeries(per_s * seconds // 2, ADA), forgeries(per_s * seconds // 2, CAROL), strict=True)
    judged = Counter(kinds(take(bob, data, tick / per_s))[0] for tick, data in enumerate(data for pair in of_each for data in pair))
    assert set(judged) == {Drop.FORGED, Drop.CROWDED}
    own = 2 * (OWN_UNKNOWN_SALTS_BURST + seconds * OWN_UNKNOWN_SALTS_PER_S)
    assert UNKNOWN_SALTS_BURST <= judged[Drop.FORGED] <= UNKNOWN_SALTS_BURST + seconds * UNKNOWN_SALTS_PER_S + own + 3


def test_forgeries_keep_nothing_from_counting_that_counts_already() -> None:
    ada, bob = introduced()
    for data in forgeries(UNKNOWN_SALTS_BURST + OWN_UNKNOWN_SALTS_BURST):
        take(bob, data)
    assert kinds(take(bob, said(boot(ADA, 1), BOB, b"anew"))) == [Drop.CROWDED]
    assert take(bob, said(ada, BOB, b"news")).packets == [b"news"]
    assert take(ada, said(bob, ADA, b"news")).packets == [b"news"]


def test_forgeries_under_the_addresses_of_others_keep_nobody_from_being_met() -> None:
    (_, bob), ada = introduced(), boot(ADA, 1)
    for tick in range(21):
        for sender in (CAROL, DAVE):
            for data in forgeries(UNKNOWN_SALTS_BURST if not tick else 300, sender):
                take(bob, data, tick / 10)
    answer = take(ada, reply(take(bob, said(ada, BOB, b"hello"), 2.0)), 2.0)
    assert take(bob, reply(answer), 2.0).packets == [b"hello"]


def test_a_node_whose_own_datagrams_were_used_up_gets_some_again() -> None:
    bob = boot(BOB)
    for data in forgeries(UNKNOWN_SALTS_BURST + OWN_UNKNOWN_SALTS_BURST):
        take(bob, data)
    now = 1.001 / OWN_UNKNOWN_SALTS_PER_S
    for data in forgeries(UNKNOWN_SALTS_BURST, CAROL):
        take(bob, data, now)
    assert take(bob, said(boot(ADA, 1), BOB, b"anew"), now).replies


def test_whose_salt_has_opened_once_is_met_beside_any_forgeries() -> None:
    ada, bob = boot(ADA, 1), boot(BOB)
    challenge = reply(take(bob, said(ada, BOB, b"hello")))
    for data in forgeries(UNKNOWN_SALTS_BURST):
        take(bob, data)
    assert take(bob, reply(take(ada, challenge))).packets == [b"hello"]
    assert take(bob, said(ada, BOB, b"news")).packets == [b"news"]


@pytest.mark.parametrize("seed", range(5))
def test_who_starts_anew_is_met_beside_three_hundred_forgeries_for_each_datagram(seed: int) -> None:
    (_, bob), ada, now, dice = introduced(), boot(ADA, 1), 0.0, random.Random(seed)
    crowd = forgeries(UNKNOWN_SALTS_BURST)
    for data in crowd:
        take(bob, data)
    heard = list[bytes]()
    for moment in range(60):
        todo = [(bob, said(ada, BOB, b"%d" % moment))]
        while todo:
            for data in crowd[: dice.randrange(600)]:
                now += 0.1 / UNKNOWN_SALTS_PER_S
                take(bob, data, now)
            now += 0.1 / UNKNOWN_SALTS_PER_S
            whom, data = todo.pop(0)
            taken = take(whom, data, now)
            heard += taken.packets
            todo += [(ada if whom is bob else bob, answer) for answer in taken.replies]
    assert heard[-1] == b"59"
