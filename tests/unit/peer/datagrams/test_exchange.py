"""If this fails, nodes can no longer talk after a restart, or hear twice, or from an earlier boot, what was said once."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.limits import DATAGRAM_BYTES_MAX, NODES_MAX
from scenefold.crypto import SealingKey, SealingPublicKey, head_of
from scenefold.peer.datagrams import PACKET_BYTES_MAX, Drop, Exchange, Taken, pairing
from scenefold.peer.datagrams import exchange as exchanges
from scenefold.peer.datagrams.pairing import ANSWER_S_MIN, CHALLENGE_S_MIN, HELD_MAX, HOLD_S
from unit.peer.datagrams.four_nodes import (
    ADA,
    BOB,
    CAROL,
    CLUSTER,
    DAVE,
    KEYS,
    boot,
    introduced,
    key_of,
    kinds,
    reply,
    said,
    source_of,
    take,
)

# ------------------------------------------------------------------------------------------------------- one by one


def test_what_was_said_first_counts_once_the_sender_has_shown_that_it_lives() -> None:
    ada, bob = introduced()
    for one, other, name in ((ada, bob, BOB), (bob, ada, ADA)):
        assert take(other, said(one, name, b"news")) == Taken(packets=[b"news"]), "from now on without further ado, both ways"


def test_a_repeated_datagram_counts_once() -> None:
    ada, bob = introduced()
    data = said(ada, BOB, b"news")
    assert take(bob, data).packets == [b"news"]
    again = take(bob, data)
    assert not again.packets and kinds(again) == [Drop.REPEATED]


def test_a_packet_that_overtakes_the_answer_counts_once() -> None:
    ada, bob = boot(ADA), boot(BOB)
    answer = reply(take(ada, reply(take(bob, said(ada, BOB, b"hello")))))
    faster = said(ada, BOB, b"news")
    assert not take(bob, faster).packets
    assert take(bob, answer).packets == [b"hello", b"news"]
    assert kinds(take(bob, faster)) == [Drop.REPEATED]


def test_what_was_said_before_the_first_answer_and_arrives_behind_it_counts_once() -> None:
    ada, bob = boot(ADA), boot(BOB)
    challenge = reply(take(bob, said(ada, BOB, b"hello")))
    slower = said(ada, BOB, b"news")
    assert take(bob, reply(take(ada, challenge))).packets == [b"hello"]
    assert take(bob, slower).packets == [b"news"]
    assert kinds(take(bob, slower)) == [Drop.REPEATED]


def test_what_an_earlier_life_of_the_receiver_has_heard_does_not_count_behind_an_answer() -> None:
    ada, bob = introduced()
    tape = [said(ada, BOB, b"%d" % number) for number in range(HELD_MAX)]
    assert [take(bob, data).packets for data in tape] == [[b"%d" % number] for number in range(HELD_MAX)]
    again = boot(BOB, 1)
    heard = take(again, reply(take(ada, reply(take(again, said(ada, BOB, b"news"), 1.0)), 1.0)), 1.0)
    assert heard.packets == [b"news"]
    assert [kinds(take(again, data, 1.0)) for data in tape] == [[Drop.REPEATED]] * HELD_MAX


def test_an_answer_that_is_lost_is_still_the_first_when_it_is_given_again() -> None:
    ada, bob = boot(ADA), boot(BOB)
    take(ada, reply(take(bob, said(ada, BOB, b"hello"))))
    slower = said(ada, BOB, b"news")
    assert take(bob, reply(take(ada, reply(take(bob, said(ada, BOB, b"hello?"), 1.0)), 1.0)), 1.0).packets == [b"hello", b"hello?"]
    assert take(bob, slower, 1.0).packets == [b"news"]


def test_who_was_forgotten_meanwhile_gives_no_first_answer_under_the_same_salt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exchanges, "PAIRINGS_MAX", 1)
    known = dict(KEYS)
    ada, bob = boot(ADA, known=lambda node: known[node].public if node in known else None), boot(BOB)
    old = said(ada, BOB, b"old")
    assert take(bob, reply(take(ada, reply(take(bob, old))))).packets == [b"old"]
    del known[BOB]
    said(ada, CAROL, b"hello")
    known[BOB] = KEYS[BOB]
    again = boot(BOB, 1)
    heard = take(again, reply(take(ada, reply(take(again, said(ada, BOB, b"news"), 1.0)), 1.0)), 1.0)
    assert heard.packets == [b"news"] and kinds(take(again, old, 1.0)) == [Drop.REPEATED]


def test_what_was_held_and_counted_does_not_count_again() -> None:
    ada, bob = boot(ADA), boot(BOB)
    first = said(ada, BOB, b"hello")
    challenge = reply(take(bob, first))
    assert kinds(take(bob, first)) == [Drop.REPEATED]
    assert take(bob, reply(take(ada, challenge))).packets == [b"hello"]
    assert kinds(take(bob, first)) == [Drop.REPEATED]


def test_an_earlier_boot_is_not_heard_after_a_later_one() -> None:
    ada, bob = introduced()
    late = [said(ada, BOB, b"old %d" % number) for number in range(3)]
    again = boot(ADA, 1)
    heard = take(bob, reply(take(again, reply(take(bob, said(again, BOB, b"new"), 1.0)), 1.0)), 1.0)
    assert heard.packets == [b"new"]
    assert [kinds(take(bob, data)) for data in late] == [[Drop.STALE]] * 3


def test_a_dead_boot_that_is_played_again_convinces_nobody() -> None:
    """Its datagrams open, but nobody answers for it."""
    ada, bob = boot(ADA), boot(BOB)
    tape = [said(ada, BOB, b"old %d" % number) for number in range(9)]
    again = boot(ADA, 1)
    now = 0.0
    for data in tape:
        now += 1.0
        taken = take(bob, data, now)
        assert not taken.packets
        for challenge in taken.replies:
            answer = take(bob, reply(take(again, challenge, now)), now)
            assert not answer.packets, "the boot that lives has answered, and it has said nothing"
            assert Drop.STALE in kinds(answer) or now > 1.0


def test_an_answer_that_was_recorded_is_no_answer_to_the_next_challenge() -> None:
    ada, bob = boot(ADA), boot(BOB)
    first = said(ada, BOB, b"old")
    answer = reply(take(ada, reply(take(bob, first))))
    later = boot(BOB, 1)
    assert take(later, first, 1.0).replies
    taken = take(later, answer, 1.0)
    assert not taken.packets and kinds(taken) == [Drop.UNASKED]


def recorded_challenges(of: Exchange, to: Exchange, name: NodeId, count: int) -> list[bytes]:
    """What one asks another, whose salt does not count there yet."""
    return [data for number in range(count) for data in take(of, said(to, name, b"hello"), number * CHALLENGE_S_MIN * 2).replies]


def test_a_challenge_that_was_recorded_is_answered_once() -> None:
    ada, bob = boot(ADA), boot(BOB)
    tape = recorded_challenges(bob, ada, BOB, 5)
    reply(take(ada, tape[3], 10.0))
    for number, data in enumerate(tape[:4]):
        again = take(ada, data, 20.0 + number)
        assert not again.replies and kinds(again) == [Drop.REPEATED]
    reply(take(ada, tape[4], 30.0))


@pytest.mark.parametrize("lives", [1, 16, 17, 60])
def test_challenges_recorded_under_many_boots_are_answered_once_each(lives: int) -> None:
    bob = boot(BOB)
    tape = [data for life in range(lives) for data in recorded_challenges(boot(ADA, life), boot(BOB), ADA, 1)]
    answered = sum(len(take(bob, tape[number % lives], 100 + number * 0.001).replies) for number in range(1000))
    assert answered == lives


def test_under_more_boots_than_are_remembered_they_are_answered_only_so_often(monkeypatch: pytest.MonkeyPatch) -> None:
    most, lives, seconds = 8, 20, 2
    monkeypatch.setattr(pairing, "UNPROVEN_SALTS_MAX", most)
    bob = boot(BOB)
    tape = [data for life in range(lives) for data in recorded_challenges(boot(ADA, life), boot(BOB), ADA, 1)]
    answered = sum(len(take(bob, tape[number % lives], 100 + number * 0.001).replies) for number in range(seconds * 1000))
    assert most < answered <= most + seconds / ANSWER_S_MIN
    take(bob, recorded_challenges(boot(ADA, 99), boot(BOB), ADA, 1)[0], 200.0)
    assert len(bob._pairings[ADA][1]._unproven) == most  # type: ignore[union-attr]


@pytest.mark.parametrize("lives", [1, 7, 40])
def test_recorded_challenges_keep_no_pair_from_meeting_that_has_started_anew(lives: int) -> None:
    ada = boot(ADA)
    tape = [data for life in range(lives) for data in recorded_challenges(boot(BOB, life), ada, BOB, 9)]
    to_bob = [data for life in range(lives) for data in recorded_challenges(boot(ADA, life), boot(BOB), ADA, 9)]
    ada, bob, now = boot(ADA, lives), boot(BOB, lives), 1000.0
    heard = list[bytes]()
    for moment in range(20):
        now += 0.05
        # As soon as an answer may be given, the tape is there.
        for recorded in tape:
            take(ada, recorded, now)
        for recorded in to_bob:
            take(bob, recorded, now)
        todo = [(bob, said(ada, BOB, b"%d" % moment))]
        while todo:
            whom, data = todo.pop(0)
            taken = take(whom, data, now)
            heard += taken.packets
            todo += [(ada if whom is bob else bob, answer) for answer in taken.replies]
    assert heard[-1] == b"19" and len(heard) >= 18


def test_an_answer_that_took_long_counts_but_finds_nothing_held() -> None:
    ada, bob = boot(ADA), boot(BOB)
    answer = reply(take(ada, reply(take(bob, said(ada, BOB, b"hello")))))
    late = take(bob, answer, HOLD_S + 1)
    assert not late.packets and kinds(late) == [Drop.STALE]
    assert take(bob, said(ada, BOB, b"news"), HOLD_S + 1).packets == [b"news"]


def test_only_so_many_are_held_and_the_newest_are() -> None:
    ada, bob = boot(ADA), boot(BOB)
    packets = [b"%d" % number for number in range(3 * HELD_MAX)]
    taken = [take(bob, said(ada, BOB, packet)) for packet in packets]
    assert sum(len(one.replies) for one in taken) == 1, "and one challenge goes for all"
    assert [kinds(one) for one in taken] == [[]] * HELD_MAX + [[Drop.CROWDED]] * (2 * HELD_MAX)
    assert take(bob, reply(take(ada, taken[0].replies[0]))).packets == packets[-HELD_MAX:]


def test_challenges_and_answers_come_only_so_often_and_again_if_they_get_lost() -> None:
    ada, bob = boot(ADA), boot(BOB)
    challenges, answers = [], 0
    for tick in range(1000):
        now = tick / 1000
        challenges += take(bob, said(ada, BOB, b"hello"), now).replies
        answers += sum(len(take(ada, challenge, now).replies) for challenge in challenges[-1:])
    assert 0.9 / CHALLENGE_S_MIN <= len(challenges) <= 1 + 1 / CHALLENGE_S_MIN
    assert answers <= 1 + 1 / ANSWER_S_MIN


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_whichever_of_the_three_is_lost_the_next_word_leads_on(lost: int) -> None:
    ada, bob = boot(ADA), boot(BOB)
    now = 0.0
    data, sides = said(ada, BOB, b"hello"), [bob, ada]
    for _ in range(lost):
        data, sides = reply(take(sides[0], data, now)), sides[::-1]
    for turn in range(2):
        now += 1.0
        one, other, name = ((ada, bob, BOB), (bob, ada, ADA))[turn]
        todo, heard = [(other, said(one, name, b"news"))], list[bytes]()
        while todo:
            whom, data = todo.pop(0)
            taken = take(whom, data, now)
            todo += [(one if whom is other else other, answer) for answer in taken.replies]
            heard += taken.packets if whom is other else []
        assert heard[-1:] == [b"news"]


def test_two_that_restarted_end_what_they_began() -> None:
    ada, bob = introduced()
    ada, bob = boot(ADA, 1), boot(BOB, 1)
    todo = [(bob, said(ada, BOB, b"from ada")), (ada, said(bob, ADA, b"from bob"))]
    heard, count = list[bytes](), 0
    while todo:
        whom, data = todo.pop(0)
        taken = take(whom, data)
        heard += taken.packets
        todo += [(ada if whom is bob else bob, answer) for answer in taken.replies]
        count += 1
        assert count <= 6, "each has challenged the other, and answered once"
    assert sorted(heard) == [b"from ada", b"from bob"]


def test_strangers_others_myself_and_noise_are_dropped_by_kind() -> None:
    ada, bob = introduced()
    good = said(ada, BOB, b"news")
    mallory = Exchange(ADA, CLUSTER, 1, SealingKey(b"m" * 32), key_of, random.Random(1).randbytes)
    elsewhere = Exchange(ADA, b"d" * 16, 1, KEYS[ADA], key_of, random.Random(1).randbytes)
    bad = {
        Drop.FOREIGN: [b"", b"\x00" * 200, good[:40], good + bytes(DATAGRAM_BYTES_MAX)],
        Drop.VERSION: [b"SFD1" + good[4:], b"SFD3"],
        Drop.MISDIRECTED: [said(ada, CAROL, b"for carol")],
        Drop.STRANGER: [good[:4] + NodeId(99).to_bytes(4, "big") + good[8:], good[:4] + BOB.to_bytes(4, "big") + good[8:]],
        Drop.FORGED: [
            said(mallory, BOB, b"news"),
            said(elsewhere, BOB, b"news"),
            said(boot(ADA, port=0), BOB, b"for the other port"),
            good[:-1],
            good[:28] + bytes(8) + good[36:] if head_of(good).counter else good[:-2],
        ],
    }
    for why, datagrams in bad.items():
        for data in datagrams:
            taken = take(bob, data)
            assert not taken.packets and not taken.replies
            assert kinds(taken) in ([why], [Drop.REPEATED]), why
    assert take(bob, good).packets == [b"news"], "and nothing of it has left a trace"


def test_who_is_known_no_longer_is_a_stranger_at_once() -> None:
    known = dict(KEYS)
    ada = boot(ADA)
    bob = boot(BOB, known=lambda node: known[node].public if node in known else None)
    heard = take(bob, reply(take(ada, reply(take(bob, said(ada, BOB, b"hello"))))))
    assert heard.packets == [b"hello"]
    del known[ADA]
    assert kinds(take(bob, said(ada, BOB, b"news"))) == [Drop.STRANGER]
    assert bob.seal(ADA, b"answer") is None


def test_a_key_of_low_order_is_nobodys() -> None:
    weak = SealingPublicKey(bytes(32))
    bob = boot(BOB, known=lambda node: weak if node == ADA else key_of(node))
    assert bob.seal(ADA, b"news") is None
    assert kinds(take(bob, said(boot(ADA), BOB, b"news"))) == [Drop.STRANGER]


def test_a_node_with_another_key_begins_anew() -> None:
    known = dict(KEYS)
    bob = boot(BOB, known=lambda node: known[node].public)
    ada = boot(ADA)
    assert take(bob, reply(take(ada, reply(take(bob, said(ada, BOB, b"hello")))))).packets == [b"hello"]
    known[ADA] = KEYS[DAVE]
    assert kinds(take(bob, said(ada, BOB, b"news"))) == [Drop.FORGED]


def test_nodes_that_went_are_forgotten_and_no_counter_is_used_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exchanges, "PAIRINGS_MAX", 8)
    here: set[NodeId] = set()
    ada = boot(ADA, known=lambda node: KEYS[BOB].public if node in here else None)
    used: set[tuple[NodeId, int]] = set()
    for turn in range(100):
        here.clear()
        here.update(NodeId(1000 + (turn * 5 + index) % 40) for index in range(5))
        for node in sorted(here):
            for _ in range(turn % 3 + 1):
                counter = head_of(said(ada, node, b"")).counter
                assert (node, counter) not in used
                used.add((node, counter))
        assert len(ada._pairings) <= 8 + 5


def test_secrets_are_agreed_on_beforehand_for_those_that_lack_one() -> None:
    ada = boot(ADA)
    said(ada, BOB, b"hello")
    unmet = ada.unmet([BOB, CAROL, DAVE, NodeId(99)])
    assert [node for node, _ in unmet] == [CAROL, DAVE]
    for (node, key), secret in zip(unmet, ada.agree([key for _, key in unmet]), strict=True):
        ada.meet(node, key, secret)
    assert not ada.unmet([BOB, CAROL, DAVE])
    assert take(boot(CAROL), said(ada, CAROL, b"hello")).replies
    counter = head_of(said(ada, BOB, b"")).counter
    ada.meet(BOB, KEYS[BOB].public, KEYS[ADA].agree(KEYS[BOB].public))
    assert head_of(said(ada, BOB, b"")).counter == counter + 1, "who is met already stays as it is"


def test_a_full_packet_fits() -> None:
    assert len(said(boot(ADA), BOB, bytes(PACKET_BYTES_MAX))) == DATAGRAM_BYTES_MAX
    assert exchanges.PAIRINGS_MAX >= 2 * NODES_MAX


# -------------------------------------------------------------------------------------------------------- any network


class Net:
    """Two nodes that restart, and a network that loses, doubles, keeps and plays again what it likes."""

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)
        self.boots = {ADA: 0, BOB: 0}
        self.nodes = {node: boot(node, 0) for node in (ADA, BOB)}
        self.tape: list[tuple[NodeId, bytes]] = []
        self.heard: dict[NodeId, list[bytes]] = {ADA: [], BOB: []}
        self.newest: dict[NodeId, int] = {ADA: 0, BOB: 0}
        self.counted: dict[NodeId, Counter[bytes]] = {ADA: Counter(), BOB: Counter()}
        self.ever: dict[NodeId, set[bytes]] = {ADA: set(), BOB: set()}
        self.again: dict[NodeId, int] = {ADA: 0, BOB: 0}
        self.now = 0.0
        self.said = 0

    def other(self, node: NodeId) -> NodeId:
        return BOB if node == ADA else ADA

    def say(self, node: NodeId) -> bytes:
        self.said += 1
        packet = b"%d of boot %d" % (self.said, self.boots[node])
        self.tape.append((self.other(node), said(self.nodes[node], self.other(node), packet)))
        return packet

    def restart(self, node: NodeId) -> None:
        """A receiver that starts anew knows nothing of what its earlier life heard."""
        self.boots[node] += 1
        self.nodes[node] = boot(node, self.boots[node])
        self.ever[node].update(self.counted[node])
        self.counted[node].clear()
        self.again[node] = 0

    def deliver(self, index: int) -> None:
        node, data = self.tape[index]
        sender, taken = self.nodes[node].take(data, source_of(data), self.now)
        assert sender == self.other(node)
        self.tape += [(sender, reply) for reply in taken.replies]
        for packet in taken.packets:
            self.heard[node].append(packet)
            self.counted[node][packet] += 1
            born = int(packet.split()[-1])
            assert born >= self.newest[node], "an earlier boot was heard after a later one"
            self.newest[node] = born
            assert self.counted[node][packet] == 1, "one life of a node heard something twice"
            self.again[node] += packet in self.ever[node]
            assert self.again[node] <= HELD_MAX, "more than was held came over from an earlier life"

    def settle(self, node: NodeId, tries: int = 6) -> None:
        """From now on the network carries everything once: what is said next is heard soon."""
        for _ in range(tries):
            self.now += CHALLENGE_S_MIN
            packet, at = self.say(node), len(self.tape) - 1
            while at < len(self.tape):
                self.deliver(at)
                at += 1
                assert at < len(self.tape) + 1 and len(self.tape) < 100_000
            if packet in self.heard[self.other(node)]:
                return
        raise AssertionError("it never converges")


def play(seed: int, steps: int) -> None:
    net = Net(seed)
    dice = net.dice
    for _ in range(steps):
        net.now += dice.choice([0.0, 0.001, 0.03, 0.2, HOLD_S])
        match dice.randrange(12):
            case 0:
                net.restart(dice.choice([ADA, BOB]))
            case 1 | 2 | 3 | 4:
                net.say(dice.choice([ADA, BOB]))
            case 5 | 6 if net.tape:
                net.deliver(dice.randrange(len(net.tape)))
            case _ if net.tape:
                net.deliver(max(0, len(net.tape) - 1 - int(dice.expovariate(0.3))))
    before = len(net.tape)
    for node in (ADA, BOB):
        net.settle(node)
    assert len(net.tape) - before < 60, "what one word leads to ends soon"


@pytest.mark.parametrize("seed", range(300))
def test_any_network_and_any_restarts(seed: int) -> None:
    play(seed, 120)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 1 << 32), st.integers(1, 400))
def test_any_seed(seed: int, steps: int) -> None:
    play(seed, steps)


def test_any_bytes_change_nothing() -> None:
    ada, bob = introduced()
    dice = random.Random(3)
    for _ in range(10_000):
        data = bytearray(said(ada, BOB, dice.randbytes(dice.randrange(60))))
        bit = dice.randrange(8 * len(data))
        data[bit // 8] ^= 1 << bit % 8
        taken = take(bob, bytes(data))
        assert not taken.packets and not taken.replies and len(taken.dropped) == 1
    assert take(bob, said(ada, BOB, b"news")).packets == [b"news"]
