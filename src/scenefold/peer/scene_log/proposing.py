"""Packet 118 for a scene whose log participants decide (specs/16-scene-log.md, Deciding).

A participant has it decided by the log, and says what became of it. Others hand a user's on to one that seems alive, and to the next one, and
call nothing refused that an earlier one may have had decided.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import trio

from scenefold.base.errors import DamagedData, NotReached, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_DECIDE_S
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Judge, Outcome, Value
from scenefold.crypto import HEADER_DOMAIN
from scenefold.peer.handlers import node_of
from scenefold.peer.logs import Answer
from scenefold.peer.modes.consent import CONSENT_S_MAX, CONSENT_TRIES
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.participation import Participation
from scenefold.peer.scene_log.proposals import accepted, rejection
from scenefold.peer.scene_log.scene_judge import SceneJudge
from scenefold.peer.scene_log.scene_run import SceneRun
from scenefold.peer.scene_log.turns import TURN_S_MAX
from scenefold.scene.log import value_of
from scenefold.wire import Packet, ProposeSceneLog, RejectSceneProposal, SceneLogPublic
from scenefold.world import Priority, QuietLog, World
from scenefold.world.buckets import Buckets

ASK_S = 6.0
"""For the participants to decide: a person waits."""
ANSWER_S = 8.0
"""For all that comes before that, too: to open the log, to learn what it lacks, to come in line, to ask observers."""
ASK_S_MIN = 1.0
"""What is left in any case: so ANSWER_S + ASK_S_MIN is the longest that a participant takes."""
BEHIND_S = 2.0
"""For a participant to open the log, and to learn what the author knew already."""
assert BEHIND_S + TURN_S_MAX + CONSENT_TRIES * CONSENT_S_MAX <= ANSWER_S
LATE_MAX = 16
"""Whose change follows a header so old, or an older one, has not tried lately: it is told so at once."""
LOOKS_BURST = 16
LOOKS_PER_S = 1.0
"""Barriers of one peer: each makes all participants write."""
RELAY_EACH_S = 10.0
"""For one participant to answer: longer than it may take, for an answer that comes just after that is one that nobody knows."""
RELAY_S_MAX = 12.0
"""For all of them: clients wait longer for a relay."""
assert ANSWER_S + ASK_S_MIN < RELAY_EACH_S < RELAY_S_MAX < CLIENT_DECIDE_S

_NOT_LOOKED_AT = frozenset({RejectReason.NOT_AUTHORISED, RejectReason.BUSY, RejectReason.KEY_REVOKED})
"""Faults that say so."""

_TOO_LATE = frozenset({RejectReason.POSITION_TAKEN, RejectReason.POSITION_BEHIND})

_log = logging.getLogger("scenefold.peer.scene_log.scenes")


class Proposing:
    """Used from the Trio thread only."""

    def __init__(self, world: World, peers: Peers, me: NodeId, participation: Participation) -> None:
        self._world, self._peers, self._me = world, peers, me
        self._participation, self._changes = participation, participation.changes
        self._looks = Buckets(LOOKS_BURST, LOOKS_PER_S)
        self._quiet = QuietLog(_log, logging.INFO)

    async def answer(self, packet: ProposeSceneLog, known: KnownScene, peer: str) -> Packet:
        """What becomes of a proposal for a scene that has participants."""
        one, began = self._participation.of(packet.public.scene), self._world.clock.now()
        if one is not None:
            # It may have become a participant a moment ago.
            with trio.move_on_after(BEHIND_S):
                await one.opened.wait()
        if one is not None and one.takes_part:
            try:
                return await self._decided(one, packet, peer, began)
            except Refused as refusal:
                self._quiet.say(self._world.clock.now(), peer, refusal.reason.name, f"a scene proposal is refused: {refusal}")
                return rejection(refusal.reason, self._me)
        deciders = [entry.member.node for entry in known.public.participants if entry.member.node != self._me]
        order = [node for node in self._peers.others() if node in deciders]
        if not order:
            must_wait = one is not None and one.must_wait
            return rejection(RejectReason.NOT_READY if must_wait else RejectReason.NOT_AUTHORISED, self._me)
        if node_of(peer) is not None:
            return rejection(RejectReason.NOT_MY_LOCATION, order[0])
        return await self._relayed(packet, order, began + RELAY_S_MAX)

    # ------------------------------------------------------------------------------------------------ participants

    async def _decided(self, one: SceneRun, packet: ProposeSceneLog, peer: str, began: float) -> Packet:
        public, until = packet.public, began + ANSWER_S
        if packet.genesis != public.genesis or public.genesis != one.public.genesis or public.decision is not None:
            raise Refused(RejectReason.ILL_FORMED, "the proposal is for another scene, or decided already")
        needed = public.position - 1 if packet.private else public.position
        if one.public.position < needed:
            one.log.catch_up(one.log.judge.participants.nodes)
            if not await one.come_to(needed, max(0.0, began + BEHIND_S - self._world.clock.now())):
                what = f"this participant knows the log up to position {one.public.position}"
                raise Refused(RejectReason.NOT_READY, what, remedy="ask another participant")
        if not packet.private:
            return await self._looked(one, public, peer, until)
        if not await self._has_place(one, public):
            return await self._proposed(one, packet, until)
        comes_back = False
        try:
            if not await one.turns.comes(public.request) and not self._is_decided(one, public):
                # It may try all the same, if nobody has gone on.
                _check_next(public, one.public)
            reply = await self._proposed(one, packet, until)
            comes_back = isinstance(reply, RejectSceneProposal) and reply.reason in _TOO_LATE
        except Refused as refusal:
            comes_back = refusal.reason in _TOO_LATE
            raise
        finally:
            one.turns.leave(public.request, comes_back=comes_back)
        return reply

    async def _has_place(self, one: SceneRun, public: SceneLogPublic) -> bool:
        """In the line of those who want the next position. Nobody else is to hold it up: as soon as there is one, it takes an owner's signature
        under something new. Refused (13) if the line is long."""
        known, judge = one.owner.known, one.log.judge
        assert isinstance(judge, SceneJudge)
        if public.position != known.public.position + 1 or len(one.turns):
            is_new = known.public.position - public.position < LATE_MAX and public.request not in judge.requests
            if not is_new or not await self._world.workers.run("crypto", _is_owners, known, public):
                return False
        return one.turns.enter(public.request)

    async def _proposed(self, one: SceneRun, packet: ProposeSceneLog, until: float) -> Packet:
        public = packet.public
        if public == one.public.proposed():
            return accepted(one.public)
        if self._is_decided(one, public):
            return accepted(one.recent[public.position])
        before = one.owner.known
        _check_next(public, before.public)
        self._changes.check(before, public, self._world.clock.now())
        value = await self._world.workers.run("crypto", _judged, one.log.judge, packet)
        one.modes.check_proposal(public, forced=packet.forced)
        is_switch = public.mode is not before.public.mode
        is_forced, for_all = is_switch and packet.forced, is_switch and not packet.forced
        if for_all and (lacking := await one.consent.lacking(one.public)) is not None:
            return lacking

        def make(judge: Judge) -> Value:
            assert isinstance(judge, SceneJudge)
            _check_next(public, judge.public)
            return value_of(public, packet.private, judge.public) if value is None else value

        try:
            # Whoever seems alive is to agree with a change of the mode, and nobody can have anything against others (specs/26-modes.md, The switch).
            answer = await one.log.ask(make, self._left_s(until), is_for_all=for_all, is_forced=is_forced, needs_consent=is_switch)
        except Refused:
            if self._is_decided(one, public):
                return accepted(one.recent[public.position])
            raise
        if is_forced and answer.reason is RejectReason.NO_MAJORITY and one.modes.is_live:
            # What it lent itself is waited for, too.
            return rejection(RejectReason.BUSY, self._me)
        return self._said(one, public, answer)

    def _said(self, one: SceneRun, public: SceneLogPublic, answer: Answer) -> Packet:
        if self._is_decided(one, public):
            return accepted(one.recent[public.position])
        by = self._me if answer.by is None else answer.by
        match answer.outcome, answer.reason:
            case Outcome.COMMITTED, _:
                # Its request is decided, at another position: the log says where.
                return rejection(RejectReason.POSITION_BEHIND, self._me)
            case Outcome.REJECTED, RejectReason.POSITION_TAKEN:
                # A higher ballot holds the position, and no value does yet.
                return rejection(RejectReason.BUSY, by)
            case Outcome.REJECTED, RejectReason.PEER_MISSED:
                return one.consent.missing(by)
            case Outcome.REJECTED, RejectReason() as reason:
                return rejection(reason, by)
            case _:
                return rejection(RejectReason.NOT_READY, self._me)

    def _is_decided(self, one: SceneRun, public: SceneLogPublic) -> bool:
        recent = one.recent.get(public.position)
        return recent is not None and recent.proposed() == public

    def _left_s(self, until: float) -> float:
        """For the participants, if all of it is to be over by then."""
        return max(ASK_S_MIN, min(ASK_S, until - self._world.clock.now()))

    async def _looked(self, one: SceneRun, public: SceneLogPublic, peer: str, until: float) -> Packet:
        """A barrier: what may have been begun behind the newest header is brought to its end, and nothing is proposed."""
        if public != one.public.proposed():
            return rejection(RejectReason.POSITION_BEHIND, self._me)
        if not self._looks.take(peer, self._world.clock.now()):
            raise Refused(RejectReason.BUSY, "what became of changes is asked too often", remedy="try again in a while")
        answer = await one.log.ask(None, self._left_s(until))
        if public != one.public.proposed():
            return rejection(RejectReason.POSITION_BEHIND, self._me)
        match answer.outcome:
            case Outcome.OPEN:
                return accepted(one.public)
            case Outcome.REJECTED:
                # A higher ballot is at it: others can be reached, and may know more.
                reason = RejectReason.BUSY if answer.reason is RejectReason.POSITION_TAKEN else answer.reason
                return rejection(reason or RejectReason.NO_MAJORITY, self._me if answer.by is None else answer.by)
            case _:
                return rejection(RejectReason.NOT_READY, self._me)

    # ---------------------------------------------------------------------------------------------------- others

    async def _relayed(self, packet: ProposeSceneLog, order: Sequence[NodeId], until: float) -> Packet:
        """The answer of a participant. Once one may have had it decided, no other one's refusal is told as one."""
        is_open = False
        reply: Packet = rejection(RejectReason.NOT_READY, self._me)
        for node in order:
            left = min(RELAY_EACH_S, until - self._world.clock.now())
            if left <= 0:
                break
            try:
                reply = await self._peers.ask(node, Priority.HIGH, packet, Packet, left)
            except (Unreachable, Refused, PeerFault) as problem:
                is_open = is_open or not _never_came(problem)
                continue
            if isinstance(reply, RejectSceneProposal) and reply.reason in (RejectReason.NOT_MY_LOCATION, RejectReason.NOT_AUTHORISED):
                # It takes no part, or does not know yet that it does.
                continue
            break
        if is_open and isinstance(reply, RejectSceneProposal):
            return rejection(RejectReason.NOT_READY, self._me)
        if isinstance(reply, RejectSceneProposal) and reply.reason is RejectReason.NOT_MY_LOCATION:
            # Nobody has looked at it: they are about to learn that they decide.
            return rejection(RejectReason.BUSY, reply.node)
        return reply


def _check_next(public: SceneLogPublic, newest: SceneLogPublic) -> None:
    if public.position == newest.position:
        raise Refused(RejectReason.POSITION_TAKEN, f"position {newest.position} is decided otherwise")
    if public.position < newest.position:
        raise Refused(RejectReason.POSITION_BEHIND, f"the scene's log is at position {newest.position} already")
    if public.position > newest.position + 1:
        raise Refused(RejectReason.NOT_READY, f"position {public.position} does not extend the log, which ends at {newest.position}")


def _judged(judge: Judge, packet: ProposeSceneLog) -> Value | None:
    """What is proposed, as a value; Refused unless it may stand at its position. None if another one is open by now. Takes some milliseconds for a long log."""
    assert isinstance(judge, SceneJudge)
    if packet.public.position != judge.public.position + 1:
        return None
    value = value_of(packet.public, packet.private, judge.public)
    judge.check(value)
    return value


def _is_owners(known: KnownScene, public: SceneLogPublic) -> bool:
    """Whether an owner has signed this, with the key that signs the scene's headers now. Takes half a millisecond."""
    key = known.keys.get(known.public.public_key)
    try:
        if key is not None:
            key.verify(public.signature, HEADER_DOMAIN, public.signable())
    except DamagedData:
        return False
    return key is not None


def _never_came(problem: Exception) -> bool:
    """Whether nothing of it was looked at."""
    return isinstance(problem, NotReached) or (isinstance(problem, Refused) and problem.reason in _NOT_LOOKED_AT)
