"""If this fails, a position from the future is believed, kept, or holds up those who decide a scene's log, whoever names it."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Accepted, Certificate, Learn, Message, Promise, Propose, Refusal, Rejected, Value, Vote
from scenefold.consensus.ballots import NO_BALLOT
from scenefold.consensus.facts import signed
from scenefold.consensus.packets import packet_of
from scenefold.crypto import LEASE_DOMAIN, SigningKey
from scenefold.peer.modes.packets import lease_message
from scenefold.scene.log import signed_header, value_of
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import votes_key
from scenefold.wire import (
    AcceptSceneProposal,
    Ballot,
    DecidedLog,
    Packet,
    Phase,
    ProposalId,
    ProposeSceneLog,
    RejectSceneProposal,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    Want,
)
from simulation.assembly import Assembly, assembled

LIAR, STORES = 1, 3
"""A participant, which names what it likes; a node that takes no part."""
HIGHEST = 2**64 - 1
"""That a packet can name."""
ANSWER_S = 4.0
"""For a participant that is asked for what lies far ahead to look whether others know of it."""


def messages_of_liar(them: Assembly, value: Value, position: int) -> list[Message]:
    """Of each kind one about this position, with facts that its node has signed; a barrier, too, for that brings no value that a judge could refuse."""
    own, genesis = them.of(LIAR).own, them.genesis
    ballot, route = Ballot(9, own.me), tuple(them.of(LIAR).routing.members)
    vote = signed(Vote(position, ballot, value.digest, own.member), genesis, own.key)
    promise = signed(Promise(position, ballot, NO_BALLOT, bytes(32), own.member), genesis, own.key)
    accept, prepare = ProposalId(position, ballot, Phase.ACCEPT), ProposalId(position, ballot, Phase.PREPARE)
    refusal = signed(Refusal(accept, RejectReason.ILL_FORMED, Ballot(2**32 - 1, own.me), own.member), genesis, own.key)
    return [
        Propose(genesis, prepare, route, (promise,), None, None),
        Propose(genesis, prepare, route, (promise,), None, value),
        Propose(genesis, accept, route, (vote,), None, value),
        Accepted(genesis, accept, value.digest, (vote,), None),
        Rejected(genesis, accept, value.digest, refusal, (vote,)),
        Learn(genesis, position, value, Certificate(position, ballot, (vote,))),
    ]


def votes_on_disks(them: Assembly, *slots: int) -> list[bytes]:
    """What these have promised and voted for at the position that is open."""
    return [bytes(them.node(slot).disk.peek(LOGS)[votes_key(them.genesis)]) for slot in slots]


def lease_asked(them: Assembly, position: int) -> RequestSceneLog:
    """As if it had come so far, and rightly signed."""
    own = them.of(LIAR).own
    plain = RequestSceneLog(them.scene, them.genesis, position, 5, Want.LEASE, own.member)
    return replace(plain, proof=own.key.sign(LEASE_DOMAIN, lease_message(plain, own.member)))


def header_of_owner(them: Assembly, header: SceneLogPublic, private: bytes, position: int) -> SceneLogPublic:
    """What an owner signs, who may sign what he likes."""
    assert them.keys.header_seed is not None
    return signed_header(replace(header, position=position), private, SigningKey.from_seed(them.keys.header_seed))


@pytest.mark.parametrize("position", [4, 2**63, HIGHEST], ids=["behind the next", "half of all", "the highest"])
def test_a_position_from_the_future_moves_nobody(position: int) -> None:
    """One that nobody has come to, in each packet of a log that names one, by a participant, an owner, and a user."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        await them.everybody_at(2, *range(STORES + 1))
        read, votes = await them.read(0), votes_on_disks(them, 0, 2)
        offered = them.following(read, them.grant())
        far = header_of_owner(them, offered.header, offered.private, position)
        value, liar = value_of(far, offered.private, read.public), f"node:{them.of(LIAR).me}"
        pushed: list[Packet] = [packet_of(message) for message in messages_of_liar(them, value, position)]
        pushed += [RespondSceneLog(None, DecidedLog(them.genesis, position, ()))]
        for decision in (None, read.public.decision):
            header = replace(far, decision=decision)
            pushed.append(RespondSceneLog(SceneLogAnswer(0, 0, position, header, None)))
        pushed.append(RequestSceneLog(them.scene, them.genesis, position, 0, Want.DECIDED))
        for slot in (0, 2, STORES):
            for packet in pushed:
                assert await them.ask(slot, packet, liar) is None
            shown = await them.ask(slot, RequestSceneLog(them.scene, them.genesis, position, 1, Want.HEADER))
            assert isinstance(shown, RespondSceneLog) and shown.answer is not None
            assert shown.answer.public.proposed() == read.public.proposed(), "whoever asks for what is not there is shown what is"
        for slot in (0, 2):
            answer = await them.ask(slot, lease_asked(them, position), liar)
            assert isinstance(answer, RespondSceneLog) and answer.answer is not None
            assert (answer.answer.flags, answer.answer.position) == (0, 2), "no lease of what is not decided"
            began = trio.current_time()
            refused = await them.ask(slot, ProposeSceneLog(them.genesis, far, offered.private))
            assert isinstance(refused, RejectSceneProposal) and refused.reason is RejectReason.NOT_READY
            assert trio.current_time() - began < ANSWER_S
        await trio.sleep(5.0)
        assert {them.position(slot) for slot in range(STORES + 1)} == {2} and votes_on_disks(them, 0, 2) == votes, (
            "nor is anything promised"
        )
        began = trio.current_time()
        reply = await them.offer(2, offered)
        assert isinstance(reply, AcceptSceneProposal) and reply.position == 3
        assert trio.current_time() - began < ANSWER_S
        await them.everybody_at(3, *range(STORES + 1))

    assembled(STORES + 1, main)


def test_a_write_floor_from_the_future_is_no_next_position() -> None:
    """All that is written has an epoch below it, so an owner could end what may be written, for ever, without a word in the log."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        read = await them.read(0)
        offered = them.following(read, them.grant())
        for floor in (3, 2**63, HIGHEST):
            header = replace(offered.header, write_floor=floor)
            header = header_of_owner(them, header, offered.private, header.position)
            refused = await them.ask(0, ProposeSceneLog(them.genesis, header, offered.private))
            assert isinstance(refused, RejectSceneProposal)
            assert (refused.reason, NodeId(refused.node)) == (RejectReason.ILL_FORMED, them.of(0).me)
        assert isinstance(await them.offer(0, offered), AcceptSceneProposal)

    assembled(3, main)
