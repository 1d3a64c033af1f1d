"""If this fails, whoever asks those that decide a scene's log is told what is not so; or who has no say in it has one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Outcome, Promise, Propose
from scenefold.consensus.facts import signed
from scenefold.consensus.packets import packet_of
from scenefold.peer.logs import Answer
from scenefold.peer.logs.intake import STRANGERS_BURST
from scenefold.peer.scene_log.proposing import ANSWER_S, ASK_S, ASK_S_MIN, BEHIND_S, LOOKS_BURST, RELAY_EACH_S
from scenefold.peer.scene_log.turns import TURN_S_MAX
from scenefold.scene.log import check_decided, opened_value, value_of
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import unpack_votes, votes_key
from scenefold.wire import (
    AcceptSceneProposal,
    AcceptValue,
    Ballot,
    DecidedLog,
    Packet,
    Phase,
    ProposalId,
    ProposeSceneLog,
    RejectSceneProposal,
    RejectValue,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogPublic,
    Want,
)
from scenefold.world.sim import Point
from scenefold.world.sim.paths import Partition
from simulation.assembly import USER, Assembly, assembled
from unit.wire.vectors import example_packet


def rejected(reply: object) -> RejectReason:
    assert isinstance(reply, RejectSceneProposal), reply
    return reply.reason


def test_answers_of_a_participant() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        read = await them.read(1)
        offered, other = them.following(read, them.grant()), them.following(read, them.grant())
        decided = await them.offer(1, offered)
        assert isinstance(decided, AcceptSceneProposal)
        again = await them.offer(1, offered)
        assert isinstance(again, AcceptSceneProposal) and again.decision == decided.decision, "the answer was lost"
        assert isinstance(await them.offer(2, offered), AcceptSceneProposal), "and at another one"
        assert rejected(await them.offer(1, other)) is RejectReason.POSITION_TAKEN
        await them.commits(1)
        late = await them.offer(1, offered)
        assert isinstance(late, AcceptSceneProposal) and late.position == decided.position, "it was decided, and more is by now"
        assert rejected(await them.offer(1, other)) is RejectReason.POSITION_BEHIND
        assert rejected(await them.ask(1, them.first)) is RejectReason.POSITION_BEHIND
        good = them.following(await them.read(1), them.grant())
        shown = replace(good.header, decision=decided.decision)
        assert rejected(await them.ask(1, ProposeSceneLog(them.genesis, shown, good.private))) is RejectReason.ILL_FORMED
        assert rejected(await them.ask(1, ProposeSceneLog(bytes(32), good.header, good.private))) is RejectReason.ILL_FORMED
        assert rejected(await them.ask(1, ProposeSceneLog(them.genesis, good.header, good.private + b"?"))) is RejectReason.ILL_FORMED
        forged = replace(good.header, signature=bytes(64))
        assert rejected(await them.ask(1, ProposeSceneLog(them.genesis, forged, good.private))) is RejectReason.SIGNATURE_INVALID
        far = replace(good.header, position=good.header.position + 1)
        assert rejected(await them.ask(1, ProposeSceneLog(them.genesis, far, good.private))) is RejectReason.NOT_READY
        assert isinstance(await them.offer(1, good), AcceptSceneProposal), "nothing of that has harmed it"

    assembled(3, main)


def test_a_participant_that_is_behind_learns_what_its_asker_knows() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        addresses = [them.node(slot).address for slot in range(3)]
        crack = them.cluster.net.partition(addresses[:2], addresses[2:])
        await them.commits(0)
        offered = them.following(await them.read(0), them.grant())
        assert rejected(await them.offer(2, offered)) is RejectReason.NOT_READY
        them.cluster.net.unite(crack)
        await trio.sleep(2.0)
        for _ in range(10):
            reply = await them.offer(2, offered)
            if isinstance(reply, AcceptSceneProposal):
                break
        assert isinstance(reply, AcceptSceneProposal) and reply.position == 3

    assembled(3, main)


def test_who_takes_no_part_hands_on_what_a_user_asks() -> None:
    async def main(them: Assembly) -> None:
        await them.create(1, 2, 3)
        assert them.of(0).participation.of(them.scene) is None, "the origin itself"
        await them.until(lambda: them.position(4) == 1)
        offered = them.following(await them.read(1), them.grant())
        packet = ProposeSceneLog(them.genesis, offered.header, offered.private)
        there = await them.ask(4, packet, "node:99")
        assert isinstance(there, RejectSceneProposal) and there.reason is RejectReason.NOT_MY_LOCATION
        assert there.node in {them.node(slot).node_id for slot in (1, 2, 3)}
        assert isinstance(await them.offer(4, offered), AcceptSceneProposal)
        await them.everybody_at(2, *range(5))
        # A participant that listens no more was certainly not reached; what the next one says counts.
        first = min((1, 2, 3), key=lambda slot: them.node(slot).node_id)
        them.crash(first)
        again = them.following(await them.read(max(1, 4 - first)), them.grant())
        reply = await them.offer(4, again)
        assert isinstance(reply, AcceptSceneProposal), reply
        header = await them.ask(4, RequestSceneLog(them.scene, them.genesis, 3, 1, Want.LOG))
        assert isinstance(header, RespondSceneLog) and header.answer is not None
        assert (header.answer.public.position, header.answer.private) == (3, None), "it says who has it"

    assembled(5, main)


def test_a_barrier_says_whether_anything_was_begun() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        await them.everybody_at(2, 0, 1, 2)
        old, newest = them.first.public, (await them.read(1)).public

        async def look(slot: int, public: SceneLogPublic, peer: str = USER) -> Packet | None:
            return await them.ask(slot, ProposeSceneLog(them.genesis, public.proposed(), b""), peer)

        assert isinstance(await look(1, newest), AcceptSceneProposal)
        assert rejected(await look(1, old)) is RejectReason.POSITION_BEHIND
        looks = [await look(2, newest, "user:eve") for _ in range(LOOKS_BURST + 8)]
        assert isinstance(looks[0], AcceptSceneProposal) and rejected(looks[-1]) is RejectReason.BUSY
        them.crash(0, 2)
        began = trio.current_time()
        assert rejected(await look(1, newest)) is RejectReason.NO_MAJORITY, "it has met nothing of which it could know no end"
        assert trio.current_time() - began < ASK_S + 0.1
        await them.start(0, 2)
        await them.commits(2)
        assert rejected(await look(0, newest)) is RejectReason.POSITION_BEHIND

    assembled(3, main)


@pytest.mark.parametrize("slot", [0, 1])
def test_whoever_asks_has_an_answer_in_time_however_silent_the_others_are(slot: int) -> None:
    """They take what is sent, and say nothing; what the one that runs has begun, and tries to bring to its end, holds up nobody who asks."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        await them.everybody_at(2, 0, 1, 2)
        read = await them.read(slot)
        others = [them.node(other).address for other in range(3) if other != slot]
        them.cluster.net.partition([them.node(slot).address], others)
        said: list[tuple[RejectReason, float]] = []

        async def asks(packet: ProposeSceneLog, after_s: float) -> None:
            await trio.sleep(after_s)
            began = trio.current_time()
            reply = rejected(await them.ask(slot, packet))
            said.append((reply, trio.current_time() - began))

        async with trio.open_nursery() as nursery:
            for number in range(3):
                offered = them.following(read, them.grant())
                nursery.start_soon(asks, ProposeSceneLog(them.genesis, offered.header, offered.private), number * 5.0)
            nursery.start_soon(asks, ProposeSceneLog(them.genesis, read.public.proposed(), b""), 8.0)
        assert max(took for _, took in said) < ANSWER_S + 0.1, said
        assert {reason for reason, _ in said} <= {RejectReason.NO_MAJORITY, RejectReason.NOT_READY}

    assembled(3, main)


def test_the_time_for_an_answer_counts_from_the_question(monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening the log, and waiting for one's turn, are a part of it."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        await them.everybody_at(2, 0, 1, 2)
        offered, one = them.following(await them.read(1), them.grant()), them.of(1).participation.of(them.scene)
        assert one is not None
        them.cluster.net.partition([them.node(1).address], [them.node(other).address for other in (0, 2)])

        async def at_the_last_moment(request: bytes) -> bool:
            await trio.sleep(TURN_S_MAX)
            return True

        async def opens() -> None:
            await trio.sleep(BEHIND_S - 0.1)
            one.opened.set()

        monkeypatch.setattr(one, "opened", trio.Event())
        them.nursery.start_soon(opens)
        monkeypatch.setattr(one.turns, "comes", at_the_last_moment)
        began = trio.current_time()
        assert rejected(await them.offer(1, offered)) in (RejectReason.NO_MAJORITY, RejectReason.NOT_READY)
        assert BEHIND_S + TURN_S_MAX < trio.current_time() - began < ANSWER_S + 0.1

    assembled(3, main)


def test_a_relay_waits_as_long_as_a_participant_may_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """And tells its answer, not that nobody knows."""

    async def main(them: Assembly) -> None:
        await them.create(1, 2, 3)
        await them.until(lambda: them.position(0) == 1)
        offered = them.following(await them.read(1), them.grant())

        async def slow(*_: object, **__: object) -> Answer:
            await trio.sleep(ANSWER_S + ASK_S_MIN)
            return Answer(Outcome.REJECTED, 2, RejectReason.NO_MAJORITY)

        for slot in (1, 2, 3):
            one = them.of(slot).participation.of(them.scene)
            assert one is not None
            monkeypatch.setattr(one.log, "ask", slow)
        began = trio.current_time()
        assert rejected(await them.offer(0, offered)) is RejectReason.NO_MAJORITY
        assert trio.current_time() - began < RELAY_EACH_S

    assembled(4, main)


def test_a_barrier_that_meets_a_higher_ballot_does_not_say_that_no_majority_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody else is at it, who can reach others: it is asked again, and the position is not taken."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        read, one = await them.read(1), them.of(1).participation.of(them.scene)
        assert one is not None
        by = them.node(2).node_id

        async def overtaken(*_: object, **__: object) -> Answer:
            return Answer(Outcome.REJECTED, 2, RejectReason.POSITION_TAKEN, by)

        monkeypatch.setattr(one.log, "ask", overtaken)
        reply = await them.ask(1, ProposeSceneLog(them.genesis, read.public.proposed(), b""))
        assert isinstance(reply, RejectSceneProposal) and (reply.reason, reply.node) == (RejectReason.BUSY, by)

    assembled(3, main)


def test_people_are_told_who_decided_and_when() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        for slot in (0, 1, 2):
            await them.commits(slot)
        await them.everybody_at(4, 0, 1, 2)

        async def told(slot: int, have: int) -> DecidedLog | None:
            reply = await them.ask(slot, RequestSceneLog(them.scene, them.genesis, have, 0, Want.DECIDED, request_id=7))
            assert isinstance(reply, RespondSceneLog) and reply.answer is None
            return reply.decided

        found = await told(1, 0)
        assert found is not None and found.newest == 4
        assert [value.position for value in found.decided] == [2, 3, 4]
        assert all(opened_value(value.value).private == b"" for value in found.decided)
        now_ms = them.of(1).world.clock.wall() * 1000
        assert all(now_ms - 60_000 < value.seen <= now_ms for value in found.decided)
        assert all(len(value.votes) >= 2 for value in found.decided)
        assert [value.position for value in (await told(2, 3) or found).decided] == [4]
        for have in (4, 5, 2**64 - 1):
            assert await told(2, have) == DecidedLog(them.genesis, 4, ())
        them.crash(1)
        await them.start(1)
        later = await told(1, 0)
        assert later is not None and [value.seen for value in later.decided] == [0, 0, 0]
        assert await told(3, 0) is None

    assembled(4, main)


class Stranger:
    """A member that takes no part, and says what it likes."""

    def __init__(self, them: Assembly, slot: int) -> None:
        self.own = them.of(slot).own
        self.name = f"node:{self.own.me}"

    def proposal(self, them: Assembly, value: Any, position: int, genesis: bytes) -> Packet:
        """Its own, signed by itself, as if it took part."""
        proposal = ProposalId(position, Ballot(9, self.own.me), Phase.PREPARE)
        promise = signed(
            Promise(position, proposal.ballot, Ballot(0, proposal.ballot.node), bytes(32), self.own.member), genesis, self.own.key
        )
        route = tuple(them.of(0).routing.members)
        return packet_of(Propose(genesis, proposal, route, (promise,), None, value))


@pytest.mark.parametrize("what", ["its own proposal", "another log", "examples", "many"])
def test_who_takes_no_part_has_no_say(what: str) -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        read = await them.read(0)
        offered, stranger = them.following(read, them.grant()), Stranger(them, 3)
        value = value_of(offered.header, offered.private, read.public)
        packets: list[Packet] = []
        if what == "its own proposal":
            packets = [stranger.proposal(them, value, 3, them.genesis), stranger.proposal(them, value, 4, them.genesis)]
        elif what == "another log":
            packets = [stranger.proposal(them, value, 3, bytes(32)), stranger.proposal(them, value, 3, them.genesis[::-1])]
        elif what == "examples":
            packets = [replace(example_packet(number), genesis=them.genesis, mini_status=None) for number in (7, 8, 9)]  # type: ignore[call-arg]
            decided = example_packet(6).decided  # type: ignore[attr-defined]
            packets.append(RespondSceneLog(None, replace(decided, genesis=them.genesis)))
        else:
            packets = [stranger.proposal(them, value, 3, them.genesis)] * (2 * STRANGERS_BURST)
        for packet in packets:
            for slot in (0, 1, 2):
                assert await them.ask(slot, packet, stranger.name) is None
        await trio.sleep(5.0)
        for slot in (0, 1, 2):
            # Each shows it by the votes that it has heard of.
            assert (await them.read(slot)).public.proposed() == read.public.proposed()
        assert await them.commits(2) == 3
        assert offered.header.request not in (await them.read(2)).log.state.requests

    assembled(4, main)


def test_a_user_says_nothing_to_those_who_decide() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        read = await them.read(0)
        offered = them.following(read, them.grant())
        value = value_of(offered.header, offered.private, read.public)
        for packet in (Stranger(them, 3).proposal(them, value, 2, them.genesis), example_packet(8), example_packet(9), example_packet(6)):
            assert isinstance(packet, AcceptValue | RejectValue) or packet.TYPE in (6, 7)
            with pytest.raises(Refused) as refused:
                await them.ask(0, replace(packet, mini_status=None))
            assert refused.value.reason is RejectReason.NOT_AUTHORISED
        assert await them.ask(0, RequestSceneLog(them.scene, them.genesis, 0, 0, Want.DECIDED)) is None, "one way, and from a user: nothing"
        check_decided((await them.read(0)).public)

    assembled(4, main)


def test_what_nobody_knows_is_not_called_refused_and_is_asked_for_again() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(1)
        await them.everybody_at(2, 0, 1, 2)
        offered = them.following(await them.read(1), them.grant())
        addresses = [them.node(slot).address for slot in range(3)]
        cracks: list[Partition] = []

        def cut_off() -> None:
            """As soon as it has put it into an ACCEPT."""
            votes = unpack_votes(them.genesis, memoryview(them.node(1).disk.peek(LOGS)[votes_key(them.genesis)]))
            if votes.slot.exposed:
                cracks.append(them.cluster.net.partition(addresses[1:2], [addresses[0], addresses[2]]))
            else:
                them.cluster.net.trap(addresses[1], Point.AFTER_COMMIT, 1, cut_off)

        cut_off()
        unknown = await them.offer(1, offered)
        assert isinstance(unknown, RejectSceneProposal) and unknown.reason is RejectReason.NOT_READY, unknown
        assert unknown.node == them.node(1).node_id
        them.cluster.net.unite(cracks[0])
        await trio.sleep(3.0)
        for _ in range(10):
            reply = await them.offer(0, offered)
            if not isinstance(reply, RejectSceneProposal) or reply.reason is RejectReason.POSITION_TAKEN:
                break
        assert isinstance(reply, AcceptSceneProposal) and reply.position == 3, reply
        await them.everybody_at(3, 0, 1, 2)
        assert isinstance(await them.offer(1, offered), AcceptSceneProposal)

    assembled(3, main)


def test_a_relay_that_one_did_not_answer_calls_nothing_refused() -> None:
    async def main(them: Assembly) -> None:
        await them.create(1, 2, 3)
        await them.until(lambda: them.position(0) == 1)
        order = sorted((1, 2, 3), key=lambda slot: them.node(slot).node_id)
        read = await them.read(order[1])
        taken, late = them.following(read, them.grant()), them.following(read, them.grant())
        assert isinstance(await them.offer(0, taken), AcceptSceneProposal), "by the connection that breaks"
        assert rejected(await them.offer(0, late)) is RejectReason.POSITION_TAKEN
        them.cluster.crash(order[0], silent=True)
        assert rejected(await them.offer(0, late)) is RejectReason.NOT_READY

    assembled(4, main)
