"""If this fails, nodes don't find each other, or believe what nobody signed, or what a removed incarnation says."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.ids import address_of, node_id_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.base.location import LAST, WHOLE_LINE, Location
from scenefold.base.prefixes import Blacklist, address_prefix
from scenefold.crypto import STATUS_DOMAIN, SealingKey, SigningKey
from scenefold.peer.membership.hearing import CLAIM_PATIENCE_S
from scenefold.peer.membership.status import arc_of_status
from scenefold.wire import Member, Packet, PingBroadcast, RemoveNode, RequestState, RequestTable, Status
from unit.peer.village import BETWEEN_ROUNDS_S, Village, incarnation_of, key_of, node_at, until, village
from unit.peer.voices import Voice, opened, say

DROPPED = pytest.mark.expect_log("is dropped|has no business here")


async def test_nodes_find_each_other_at_once(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        for index in range(5):
            await them.start(index)
        with trio.fail_after(1.0):
            for node in them.nodes.values():
                await node.gossip.everybody_heard()
                await node.gossip.somebody_heard()
        assert all(len(node.roster.alive()) == 5 for node in them.nodes.values())


async def test_a_seed_tells_of_the_others(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5, seeds=("127.0.0.2",)) as them:
        # The newcomer reaches the seed alone: it knows the rest from its table.
        them.ether.lost = lambda source, target: "127.0.0.6" in (source, target) and "127.0.0.2" not in (source, target)
        for index in range(5):
            await them.start(index)
        with trio.fail_after(120.0):
            await them.of(4).gossip.a_seed_heard()
            await them.of(4).gossip.everybody_heard()


async def test_who_falls_silent_is_not_believed_alive_for_long(autojump_clock: trio.testing.MockClock) -> None:
    async with village(4) as them:
        for index in range(4):
            await them.start(index)
        await them.of(0).gossip.everybody_heard()
        silent = address_of(them.of(3).own.me)
        them.ether.lost = lambda source, _target: source == silent
        with trio.fail_after(300.0):
            await until(lambda: not them.of(0).roster.is_believed_alive(them.of(3).own.me))
        assert them.of(0).roster.is_believed_alive(them.of(1).own.me)
        them.ether.lost = lambda _source, _target: False
        with trio.fail_after(60.0):
            await until(lambda: them.of(0).roster.is_believed_alive(them.of(3).own.me))


async def test_datagrams_stay_small_and_the_table_goes_round(autojump_clock: trio.testing.MockClock) -> None:
    async with village(25) as them:
        for index in range(25):
            await them.start(index)
        with trio.fail_after(10.0):
            for node in them.nodes.values():
                await node.gossip.everybody_heard()
        await trio.sleep(20)
        sizes = [len(data) for _source, _target, data in them.ether.sent]
        assert max(sizes) <= DATAGRAM_BYTES_MAX
        assert max(sizes) > DATAGRAM_BYTES_MAX * 3 // 4, "there was room for more"


async def test_the_own_status_comes_first(autojump_clock: trio.testing.MockClock) -> None:
    async with village(4) as them:
        for index in range(4):
            await them.start(index)
        await trio.sleep(30)
        for source, target, data in them.ether.sent:
            node, packet = node_id_of(source), opened(source, target, data)
            if isinstance(packet, PingBroadcast):
                assert packet.statuses[0].node == node
            elif packet is not None:
                assert isinstance(packet, RequestState) and packet.mini_status is not None and packet.mini_status.node == node


async def test_a_changed_arc_is_told_at_once_but_not_as_a_throw_of_the_dice(autojump_clock: trio.testing.MockClock) -> None:
    async with village(30) as them:
        await them.start(0)
        await them.start(1)
        await trio.sleep(3.0)
        before, arc = len(them.ether.sent), them.of(1).own.arc
        them.of(1).own.arc = None
        with trio.fail_after(3.0):
            await until(lambda: them.of(0).roster.arcs()[node_at(1)] is None)
        told = [
            opened(source, target, data)
            for source, target, data in them.ether.sent[before:]
            if (source, target) == ("127.0.0.3", "127.0.0.2")
        ]
        assert [packet.request_id for packet in told if isinstance(packet, PingBroadcast)] != []
        for changed in (arc, None) * 50:
            them.of(1).own.arc = changed
            await trio.sleep(0.1)
        many = [data for source, target, data in them.ether.sent[before:] if (source, target) == ("127.0.0.3", "127.0.0.2")]
        assert len(many) <= 16, "once a second at most"


async def test_a_changed_blacklist_is_told_at_once(autojump_clock: trio.testing.MockClock) -> None:
    async with village(30) as them:
        await them.start(0)
        await them.start(1)
        await trio.sleep(3.0)
        them.of(1).own.blacklist = Blacklist(1, (address_prefix("10.1.2.0/24"),))
        with trio.fail_after(3.0):
            await until(lambda: [status.blacklist_version for status in them.of(0).roster.statuses() if status.node == node_at(1)] == [1])


async def test_a_changed_fill_is_told_at_once_and_one_that_is_about_the_same_is_not(autojump_clock: trio.testing.MockClock) -> None:
    async with village(200) as them:
        await them.start(0)
        await them.start(1)
        own = them.of(1).own
        own.update(disk_used_bytes=32 << 20, disk_total_bytes=1 << 30)

        def fractions() -> set[float]:
            """What was told to one that asked for nothing."""
            told = [
                opened(source, target, data) for source, target, data in them.ether.sent if (source, target) == ("127.0.0.3", "127.0.0.9")
            ]
            return {
                packet.statuses[0].offline_fraction / 2**32
                for packet in told
                if isinstance(packet, PingBroadcast)
                if packet.request_id == 1
            }

        with trio.fail_after(10.0):
            await until(lambda: 1 / 32 in fractions())
        them.ether.sent.clear()
        own.update(disk_used_bytes=(32 << 20) + (400 << 10))
        await trio.sleep(30.0)
        assert fractions() <= {1 / 32}, "balance does not care"
        own.update(disk_used_bytes=33 << 20)
        with trio.fail_after(10.0):
            await until(lambda: 33 / 1024 in fractions())


# ----------------------------------------------------------------------------------------------------------- the log


async def test_members_come_and_go_with_the_log(autojump_clock: trio.testing.MockClock) -> None:
    async with village(4, registered=3) as them:
        for index in range(4):
            await them.start(index)
        await trio.sleep(5)
        assert not them.of(0).roster.is_believed_alive(node_at(3)), "it speaks, but nobody has registered it"
        them.register(3)
        with trio.fail_after(1.0):
            for node in them.nodes.values():
                await node.gossip.everybody_heard()
        them.commit(RemoveNode(Member(node_at(1), incarnation_of(1)), "test"))
        await trio.sleep(30)
        assert list(them.of(0).roster.peers) == [node_at(2), node_at(3)]
        assert [status.node for status in them.of(0).roster.statuses()] == [node_at(2), node_at(3)]


async def test_a_removed_incarnation_is_not_heard_under_its_successor(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        for index in range(3):
            await them.start(index)
        await trio.sleep(5)
        them.commit(RemoveNode(Member(node_at(2), incarnation_of(2)), "test"))
        await trio.sleep(5)
        # The old one still speaks, and tells others what it believes.
        assert not them.of(0).roster.is_peer(node_at(2))
        assert [status.node for status in them.of(0).roster.statuses()] == [node_at(1)]


async def test_who_knows_more_of_the_log_is_noticed_before_it_is_known(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3, registered=2) as them:
        for index in range(3):
            await them.start(index)
        await trio.sleep(1)
        behind = them.of(0).log
        behind.adopt = lambda _registry: None  # type: ignore[method-assign]
        them.register(2)
        await trio.sleep(60)
        assert not them.of(0).roster.status(node_at(2)), "it has not been told"
        assert (node_at(2), them.registry.position) in behind.claims, "a stranger may be right: we may be behind"


async def test_an_old_datagram_does_not_depose_an_incarnation_after_a_restart(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        old = them.of(1).own
        before = PingBroadcast((signed(replace(old.signed(), incarnation=b"o" * 16, lamport=9 << 32, boot=9)),))
        await them.start(0)
        await them.start(1)
        await them.of(0).gossip.everybody_heard()
        await say(them.of(1), before, node_at(0))
        await trio.sleep(30)
        assert them.of(0).roster.incarnation(node_at(1)) == incarnation_of(1)
        status = them.of(0).roster.status(node_at(1))
        assert status is not None and status.incarnation == incarnation_of(1) and status.boot == 1


# ----------------------------------------------------------------------------------------------------- what is forged


def signed(status: Status, key: SigningKey | None = None) -> Status:
    return replace(status, signature=(key or key_of(status.node)).sign(STATUS_DOMAIN, status.signable()))


FORGERIES = ["signed by a stranger", "passed on, but changed", "of another address", "of another boot", "no packet", "another packet"]


def forgery(village: Village, kind: str) -> Packet | bytes:
    """What node 1 may tell node 0 that must not change what it believes."""
    status = village.of(1).own.signed()
    news = replace(status, lamport=status.lamport + 1000)
    match kind:
        case "signed by a stranger":
            return PingBroadcast((signed(news, SigningKey.from_seed(b"?" * 32)),))
        case "passed on, but changed":
            return PingBroadcast((news,))
        case "of another address":
            return PingBroadcast((signed(replace(news, address="10.0.0.1")),))
        case "of another boot":
            return PingBroadcast((signed(replace(news, boot=7)),))
        case "no packet":
            return b"\xc1"
        case _:
            return RequestTable()


@pytest.mark.parametrize("kind", FORGERIES)
@DROPPED
async def test_what_does_not_verify_changes_nothing(kind: str, autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        await Voice(them, node_at(1)).say(forgery(them, kind), node_at(0))
        assert them.of(0).gossip.dropped == 1
        assert them.of(0).roster.unheard() == [node_at(1)]


@pytest.mark.expect_log("an internal error, OverflowError")
async def test_a_datagram_over_which_a_node_fails_ends_it_not(
    autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with village(2) as them:
        await them.start(0)

        def failing(*_: object) -> None:
            raise OverflowError

        with monkeypatch.context() as patched:
            patched.setattr(them.of(0).gossip._hearing, "hear", failing)
            await Voice(them, node_at(1)).say(PingBroadcast((them.of(1).own.signed(),)), node_at(0))
        with monkeypatch.context() as patched:
            patched.setattr(them.of(0).gossip._datagrams._exchange, "take", failing)
            them.ether.send(bytes(100), "10.1.1.1", "127.0.0.2")
            await trio.testing.wait_all_tasks_blocked()
        await them.start(1)
        with trio.fail_after(100):
            await them.of(0).gossip.everybody_heard()


@pytest.mark.parametrize(
    "kind", ["truncated", "noise", "empty", "for another", "from a stranger", "from myself", "from elsewhere", "under a stolen name"]
)
@DROPPED
async def test_what_does_not_open_is_no_datagram(kind: str, autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        news = PingBroadcast((them.of(1).own.signed(),))
        data = Voice(them, node_at(1)).sealed(news, node_at(0))
        forged, source = {
            "truncated": (data[:-10], "127.0.0.3"),
            "noise": (b"\x00" * 200, "127.0.0.3"),
            "empty": (b"", "127.0.0.3"),
            "for another": (Voice(them, node_at(1)).sealed(news, node_at(5)), "127.0.0.3"),
            "from a stranger": (Voice(them, node_id_of("9.9.9.9")).sealed(news, node_at(0)), "9.9.9.9"),
            "from myself": (Voice(them, node_at(0)).sealed(news, node_at(0)), "127.0.0.2"),
            "from elsewhere": (data, "10.1.1.1"),
            "under a stolen name": (Voice(them, node_at(1), SealingKey(b"?" * 32)).sealed(news, node_at(0)), "127.0.0.3"),
        }[kind]
        sent = len(them.ether.sent)
        them.ether.send(forged, source, "127.0.0.2")
        await trio.testing.wait_all_tasks_blocked()
        assert them.of(0).gossip.dropped == 1 and len(them.ether.sent) == sent + 1, "and it is not even answered"
        assert them.of(0).roster.unheard() == [node_at(1)]


@pytest.mark.expect_log(
    "127.0.0.3: a datagram is dropped: (it is of version 3, this node takes version 2: let all nodes run|.* none of ours)"
)
async def test_datagrams_of_a_later_version_are_dropped_counted_and_named_once(
    autojump_clock: trio.testing.MockClock, caplog: pytest.LogCaptureFixture
) -> None:
    async with village(2) as them:
        await them.start(0)
        whole = Voice(them, node_at(1)).sealed(PingBroadcast((them.of(1).own.signed(),)), node_at(0))
        for _ in range(5):
            them.ether.send(b"SFD3" + whole[4:], "127.0.0.3", "127.0.0.2")
        them.ether.send(b"\x00" * 200, "127.0.0.3", "127.0.0.2")
        await trio.testing.wait_all_tasks_blocked()
        assert them.of(0).gossip.dropped == 6
        assert sum("of version 3" in record.getMessage() for record in caplog.records) == 1
        assert sum("none of ours" in record.getMessage() for record in caplog.records) == 1, "one complaint hides no other"
        assert them.of(0).roster.unheard() == [node_at(1)]


@DROPPED
async def test_a_claim_on_what_is_ours_is_not_believed(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        await them.start(1)
        await them.of(0).gossip.everybody_heard()
        bound = them.of(1).own.arc
        them.of(1).own.arc = WHOLE_LINE
        await trio.sleep(CLAIM_PATIENCE_S + 30)
        assert bound is not None and them.of(0).gossip.dropped > 0
        (sign,) = them.of(0).gossip.signs.documents(trio.current_time())
        assert (sign["kind"], sign["source"]) == ("contested", "127.0.0.3")
        status = them.of(0).roster.status(node_at(1))
        assert status is not None and status.left_fence == Location.from_number(bound.first.number - 1) and status.right_bound == LAST


@pytest.mark.expect_log(r"claims places that are ours($|, by position 77 of the cluster's log, and nobody has shown us that)")
async def test_a_log_that_nobody_can_show_gives_no_right_to_what_is_ours(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        for index in range(3):
            await them.start(index)
        await them.of(0).gossip.everybody_heard()
        await them.of(2).gossip.everybody_heard()
        before = them.of(0).roster.status(node_at(1))
        assert before is not None
        them.of(1).own.arc, them.of(1).own.log_position = WHOLE_LINE, 77
        await trio.sleep(CLAIM_PATIENCE_S + 30)
        for index in (0, 2):
            other = them.of(index)
            status = other.roster.status(node_at(1))
            assert status is not None and status.right_bound == before.right_bound, "not even one whose arc is not claimed believes it"
            assert other.roster.arcs()[node_at(1)] == arc_of_status(before)
            assert other.roster.is_believed_alive(node_at(1)), "it lives all the same"
            assert (node_at(1), 77) in other.log.claims, "and the log is asked for"


async def test_who_is_claimed_against_tells_all_where_its_arc_is(autojump_clock: trio.testing.MockClock) -> None:
    async with village(30) as them:
        for index in range(3):
            await them.start(index)
        await trio.sleep(120 + BETWEEN_ROUNDS_S)
        victim, liar = them.of(0), them.of(1)
        claim = signed(replace(liar.own.signed(), left_fence=None))
        lie = PingBroadcast((claim,), request_id=1)
        third = them.of(2).roster
        await say(liar, lie, node_at(2))
        assert third.said_at(liar.own.me) > third.said_at(victim.own.me), "for a moment the liar has the last word"
        await trio.sleep(0.01)
        await say(liar, lie, victim.own.me)
        with trio.fail_after(3.0):
            await until(lambda: third.said_at(victim.own.me) > third.said_at(liar.own.me))


@pytest.mark.expect_log("somebody else has its key")
async def test_who_hears_its_own_key_speak_has_the_last_word(autojump_clock: trio.testing.MockClock) -> None:
    async with village(4) as them:
        for index in range(3):
            await them.start(index)
        await trio.sleep(60)
        robbed, third = them.of(1), them.of(2).roster
        true = robbed.own.arc
        stolen = signed(replace(robbed.own.signed(), left_fence=None, lamport=(1 << 32) + 5_000_000))
        await Voice(them, node_at(3)).say(PingBroadcast((them.of(3).own.signed(), stolen)), node_at(2))
        assert third.arcs()[robbed.own.me] != true
        with trio.fail_after(120.0):
            await until(lambda: third.arcs()[robbed.own.me] == true)
        assert [(sign["kind"], sign["count"]) for sign in robbed.gossip.signs.documents(trio.current_time())] == [("own key", 1)]
        for lamport in ((2 << 32) + 1, (1 << 32) + (1 << 32) - 1, (1 << 32) + 1):
            assert not robbed.own.may_follow(lamport), "another boot, no room behind it, or the past"


async def test_a_repeated_status_is_no_sign_of_life(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        friend, roster = them.of(1), them.of(0).roster
        voice, old = Voice(them, friend.own.me), PingBroadcast((friend.own.signed(),))
        await voice.say(old, node_at(0))
        assert roster.is_believed_alive(friend.own.me)
        with trio.fail_after(600):
            while roster.is_believed_alive(friend.own.me):
                await voice.say(old, node_at(0))
                await trio.sleep(1.0)
        assert them.of(0).gossip.dropped == 0


async def test_a_repeated_question_is_no_flood_of_answers(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        friend = them.of(1)
        voice, question = Voice(them, friend.own.me), RequestState(request_id=1)
        await voice.say(PingBroadcast((friend.own.signed(),)), node_at(0))
        await trio.sleep(1.0 + BETWEEN_ROUNDS_S)

        def answers(since: int) -> int:
            told = (opened(source, target, data) for source, target, data in them.ether.sent[since:] if source == "127.0.0.2")
            return sum(isinstance(packet, PingBroadcast) and packet.request_id == 1 for packet in told)

        before = len(them.ether.sent)
        for _ in range(200):
            await voice.say(question, node_at(0))
        assert answers(before) == 1
        await trio.sleep(1.0)
        before = len(them.ether.sent)
        await voice.say(question, node_at(0))
        assert answers(before) >= 1


# -------------------------------------------------------------------------------------------------------- many, or none
