"""The leases of one scene at a node that decides its log: asked for, granted, and what the log has to know of them (specs/26-modes.md).

Leases are asked for only while somebody wants to act by one. What hangs together how is `Standing`'s; here are the clock, the other nodes and
the signatures. Nothing here waits between a look at `standing` and what is said by it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from functools import partial

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Certificate, Decide, Judge, Participants, Slot, Value, Vote
from scenefold.consensus.facts import Fact, true_facts
from scenefold.crypto import LEASE_DOMAIN, PublicKey
from scenefold.peer.logs.ports import Owner
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.granter import Verdict
from scenefold.peer.modes.lender import Borrower
from scenefold.peer.modes.packets import check_proof, lease_message, said_in
from scenefold.peer.modes.scene import DecidedScene
from scenefold.peer.modes.standing import Standing
from scenefold.peer.peers import Peers
from scenefold.peer.scene_log.scene_judge import SceneJudge, participants_after
from scenefold.peer.timing import LEASE_ASK_S_MAX, LEASE_RETRY_S, RENEW_S, T_WAIT_S
from scenefold.peer.waiters import Waiters
from scenefold.scene.log import opened_value
from scenefold.wire import (
    DecidedLog,
    DecidedValue,
    LogValue,
    MalformedPacket,
    Member,
    Packet,
    ParticipantEntry,
    Phase,
    ProposalId,
    Release,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    SceneMode,
    Want,
)
from scenefold.world import Priority, World

GRANT = 1
WANTED_S = 30.0
"""So long leases are asked for behind the last time that somebody wanted one."""
ASKED_BACK_S = 5.0
"""Who is told that a lease is asked back settles what it has signed, and gives it back; nobody else is lent anything meanwhile."""
LOOK_S = 0.1
SAID_TIMES = 3
"""What a node says of a switch is sent so often: it may be lost, and who does not hear it waits T_WAIT."""
SAID_PAUSE_S = 2.0
_NOBODY = bytes(16)

_log = logging.getLogger("scenefold.peer.modes")


class SceneModes(Owner):
    """Used from the Trio thread only. `behind` is called when somebody knows more of the log than this node."""

    def __init__(
        self, world: World, peers: Peers, own: OwnStatus, public: SceneLogPublic, behind: Callable[[], object], *, is_new: bool = False
    ) -> None:
        """`is_new`: this node never decided this log in a life before this one."""
        self._world, self._peers, self._own, self._behind = world, peers, own, behind
        self._news = Waiters()
        self.begins_at(public, is_new=is_new)

    def begins_at(self, public: SceneLogPublic, *, is_new: bool = False) -> None:
        """The scene as this node knows it at a start, or behind positions that it never learnt."""
        self.public = public
        was_switched = public.mode is not SceneMode.EDIT or public.write_floor > 0
        me, scene = self._own.member, DecidedScene.of(public)
        self.standing = Standing.started(me, scene, self._now(), was_switched=was_switched, may_have_lent=not is_new)
        self._before = public
        self._switch: Decide | None = None
        self._to_say = 0
        self._wanted_until = -1.0
        self._released: dict[Member, Release] = {}
        self._asked_back_until = -1.0
        self._nonces: dict[Borrower, int] = {}

    def _now(self) -> float:
        return self._world.clock.now()

    # ------------------------------------------------------------------------------------------------- for others

    @property
    def is_active(self) -> bool:
        """Whether the mode that was decided last may be acted by, as far as this node knows."""
        return self.standing.is_active(self._now())

    async def acting(self, within_s: float) -> SceneMode | None:
        """The mode that this node may act in at this moment; it waits so long for that. None: unknown."""
        await self._until(lambda: self.standing.acts_in(self._now()) is not None, within_s)
        return self.standing.acts_in(self._now())

    async def leased(self, within_s: float) -> bool:
        """Whether this node holds a lease, whatever mode is active; it waits so long for one."""
        await self._until(lambda: self.standing.holder.lease(self._now()) is not None, within_s)
        return self.standing.holder.lease(self._now()) is not None

    async def _until(self, holds: Callable[[], bool], within_s: float) -> None:
        self._wanted_until = self._now() + WANTED_S
        self._news.tell()
        with trio.move_on_after(within_s):
            while not holds():
                # Time alone may make a mode active, and nobody tells of it.
                await self._world.clock.sleep(LOOK_S)

    def lend(self, borrower: Borrower, mode: SceneMode, nonce: int) -> tuple[float, bool]:
        """For how long, and whether it is asked back. Refused (9) if this node may not act in that mode now; 8, 13."""
        now = self._now()
        self._check_nonce(borrower, nonce)
        acts_in = self.standing.acts_in(now)
        if acts_in is not mode:
            what = "the scene's mode is unknown here" if acts_in is None else f"the scene is in {acts_in.name.lower()} mode"
            raise Refused(RejectReason.MODE_FORBIDS, what)
        is_asked_back = now < self._asked_back_until
        is_renewal = borrower in self.standing.lender.borrowers(now)
        if not self.standing.may_lend(borrower, now) or (is_asked_back and not is_renewal):
            raise Refused(
                RejectReason.BUSY, "the scene's mode is about to change, or too many leases are lent", remedy="try again in a while"
            )
        self._nonces[borrower] = nonce
        self.standing, left_s = self.standing.lends(borrower, now)
        return left_s, is_asked_back

    def take_back(self, borrower: Borrower, nonce: int) -> None:
        """The client uses it no more."""
        self._check_nonce(borrower, nonce)
        self.standing = self.standing.given_back(borrower)
        self._news.tell()

    def _check_nonce(self, borrower: Borrower, nonce: int) -> None:
        """What was asked for, or given back, before counts no more when it comes once more."""
        live = self.standing.lender.borrowers(self._now())
        self._nonces = {known: last for known, last in self._nonces.items() if known in live}
        if nonce <= self._nonces.get(borrower, 0):
            raise Refused(RejectReason.STALE_VERSION, "this client has asked for something since")

    async def on_lease(self, packet: RequestSceneLog, asker: NodeId) -> Packet:
        """5 (LEASE) of another node. Refused (12, 4) if it may hold none; an answer without GRANT if not now."""
        member = packet.member
        if member is None or member.node != asker:
            raise Refused(RejectReason.NOT_AUTHORISED, "a lease is asked for by whoever is to hold it")
        key = self._key_of(member, self.public)
        if key is not None:
            await self._world.workers.run("crypto", partial(check_proof, key, packet, member))
        verdict = self.standing.judges(member, packet.have)
        if verdict in (Verdict.STRANGER, Verdict.SILENT):
            who = "the asker" if verdict is Verdict.STRANGER else "this node"
            raise Refused(RejectReason.NOT_AUTHORISED, f"{who} takes no part in the scene's next position")
        if verdict is Verdict.NOT_HERE_YET:
            self._behind()
        flags = GRANT if verdict is Verdict.GRANT else 0
        return RespondSceneLog(SceneLogAnswer(packet.nonce, flags, self.public.position, self.public, None))

    def shown(self, packet: Packet) -> None:
        """A packet about this log: votes and releases in it may make the mode active."""
        position, facts, releases = said_in(packet, 0 if self._switch is None else self._switch.position)
        for release in releases:
            self._hear(release)
        if self._switch is not None and position == self._switch.position and not self.is_active:
            self._count(facts, self._switch)
        self._news.tell()

    def check_proposal(self, public: SceneLogPublic) -> None:
        """Refused (13) if this node itself must not vote for what is asked for here."""
        is_switch = public.mode is not self.public.mode
        if self.standing.abstains(is_switch=is_switch, now=self._now()):
            self._asked_back_until = self._now() + ASKED_BACK_S
            what = "leases that this node lent, now or before its start, may still be used"
            raise Refused(RejectReason.BUSY, what, remedy=f"try again in {T_WAIT_S:.0f} s, or at another participant")

    # ------------------------------------------------------------------------------------------------- for the log

    def veto(self, value: Value | None) -> RejectReason | None:
        if value is None or not self.standing.lender.borrowers(self._now()) or not self._is_switch(value):
            return None
        self._asked_back_until = self._now() + ASKED_BACK_S
        return RejectReason.BUSY

    def abstains(self, value: Value) -> bool:
        return self.standing.abstains(is_switch=self._is_switch(value), now=self._now())

    def votes(self, value: Value) -> None:
        is_switch = self._is_switch(value)
        if self.standing.abstains(is_switch=is_switch, now=self._now()):
            # Lent since this node was asked, or it is its own proposal: nobody asks it then.
            raise Refused(RejectReason.BUSY, "something that was lent may still be used")
        self.standing = self.standing.votes(is_switch=is_switch)

    def stands(self, slot: Slot, *, is_silent: bool) -> None:
        accepted = slot.accepted
        speaker = Member(self._own.me, _NOBODY) if is_silent else self._own.member
        is_switch = accepted is not None and self._is_switch(accepted.value)
        self.standing = self.standing.stands(has_accepted=accepted is not None, is_switch=is_switch, speaker=speaker)
        self._news.tell()

    def decided(self, decided: Decide, after: Judge) -> None:
        assert isinstance(after, SceneJudge)
        before, public, proof = self.public, after.public, decided.certificate
        votes = self._true_votes(proof.votes, proof, decided.value, before)
        scene, now = DecidedScene.of(public), self._now()
        is_switch = self.standing.scene.is_switched_by(scene)
        self.standing = self.standing.decided(scene, decided.value.digest, proof.ballot, votes, now)
        self.public = public
        if is_switch:
            # Who was neither there before nor is now has nothing to say, and nobody to say it to.
            is_there = self._own.member in DecidedScene.of(before).everyone
            self._before, self._switch, self._to_say = before, decided, SAID_TIMES if is_there else 0
            for release in self._released.values():
                self._hear(release)
        self._news.tell()

    def _is_switch(self, value: Value) -> bool:
        try:
            return opened_value(value).public.mode is not self.public.mode
        except MalformedPacket:
            # The judge has refused it.
            return False

    # ------------------------------------------------------------------------------------------------------- facts

    def _true_votes(self, votes: Iterable[Fact], proof: Certificate, value: Value, before: SceneLogPublic) -> list[Vote]:
        deciders: Participants = participants_after(before)
        proposals = {ProposalId(vote.position, vote.ballot, Phase.ACCEPT) for vote in votes if vote.position == proof.position}
        found = [fact for proposal in proposals for fact in true_facts(votes, proposal, value.digest, before.genesis, deciders)]
        return [fact for fact in found if isinstance(fact, Vote)]

    def _count(self, facts: Iterable[Fact], switch: Decide) -> None:
        seen = self.standing.activation.voters
        new = [fact for fact in facts if isinstance(fact, Vote) and fact.member not in seen]
        for vote in self._true_votes(new, switch.certificate, switch.value, self._before):
            self.standing = self.standing.voted(vote)

    def _hear(self, release: Release) -> None:
        """Of somebody who may hold leases now, or might before the switch."""
        known = self._released.get(release.member)
        if known is not None and known.position >= release.position and self.standing.releases.cover(release.member, release.position):
            return
        key = self._key_of(release.member, self._before) or self._key_of(release.member, self.public)
        if key is None:
            return
        try:
            key.verify(release.signature, Release.DOMAIN, release.signable(self.public.genesis))
        except DamagedData:
            return
        self._released[release.member] = release
        self.standing = self.standing.heard(release.member, release.position)

    def _key_of(self, member: Member, public: SceneLogPublic) -> PublicKey | None:
        everyone: tuple[ParticipantEntry, ...] = (*public.participants, *public.observers)
        return next((PublicKey(entry.key) for entry in everyone if entry.member == member), None)

    # -------------------------------------------------------------------------------------------------------- task

    async def run(self) -> None:
        """Until cancelled: ask for leases while somebody wants them, and say of a switch what may be said."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._keep_asking)
            nursery.start_soon(self._keep_saying)

    async def _keep_asking(self) -> None:
        while True:
            await self._news.until(lambda: self._now() < self._wanted_until and self.standing.may_ask)
            asked_at = self._now()
            await self._ask()
            lease = self.standing.holder.held
            is_new = lease is not None and self.standing.holder.lease(asked_at) is not None
            pause = RENEW_S if is_new else LEASE_RETRY_S
            await self._world.clock.sleep(max(0.0, asked_at + pause - self._now()))

    async def _ask(self) -> None:
        nonce = int.from_bytes(self._world.entropy.token(8), "big")
        self.standing = self.standing.asks(nonce, self._now())
        public, member = self.public, self._own.member
        plain = RequestSceneLog(public.scene, public.genesis, public.position, nonce, Want.LEASE, member)
        proof = self._own.key.sign(LEASE_DOMAIN, lease_message(plain, member))
        packet = RequestSceneLog(public.scene, public.genesis, public.position, nonce, Want.LEASE, member, proof)
        async with trio.open_nursery() as nursery:
            for node in self.standing.scene.deciders - {member.node}:
                nursery.start_soon(self._ask_one, node, packet)
        self._news.tell()

    async def _ask_one(self, node: NodeId, packet: RequestSceneLog) -> None:
        try:
            answer = (await self._peers.ask(node, Priority.HIGH, packet, RespondSceneLog, LEASE_ASK_S_MAX)).answer
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("no lease of scene %08x from node %s: %s", packet.scene, node, problem)
            return
        if answer is None or answer.nonce != packet.nonce:
            return
        if answer.flags & GRANT:
            self.standing = self.standing.granted(packet.nonce, node)
            self._news.tell()
        elif answer.position > self.public.position:
            self._behind()

    async def _keep_saying(self) -> None:
        while True:
            await self._news.until(lambda: self._to_say > 0 and self._switch is not None)
            assert self._switch is not None
            self._release()
            if self._own.member in self.standing.releases.heard:
                await self._say(self._switch)
                self._to_say -= 1
            await self._world.clock.sleep(SAID_PAUSE_S)

    def _release(self) -> None:
        """Sign it as soon as it is true. It stays so: who has decided the switch asks for no lease of before any more, also after a start."""
        position = self.standing.release(self._now())
        if position is not None:
            plain = Release(position, self._own.member)
            signature = self._own.key.sign(Release.DOMAIN, plain.signable(self.public.genesis))
            self._hear(Release(position, self._own.member, signature))

    async def _say(self, switch: Decide) -> None:
        """All that is known of who released it, to everybody who waits for that."""
        proof, before, after = switch.certificate, DecidedScene.of(self._before), self.standing.scene
        releases = tuple(release for release in self._released.values() if release.position >= switch.position)
        # The data alone: it is no news to who has decided it, and nothing to others.
        value = DecidedValue(switch.position, LogValue(switch.value.data), proof.ballot, proof.votes, releases)
        packet = RespondSceneLog(None, DecidedLog(self.public.genesis, switch.position, (value,)))
        nodes = {member.node for member in before.everyone | after.everyone} - {self._own.me}
        async with trio.open_nursery() as nursery:
            for node in sorted(nodes):
                nursery.start_soon(self._tell, node, packet)

    async def _tell(self, node: NodeId, packet: Packet) -> None:
        try:
            await self._peers.tell(node, Priority.HIGH, packet, LEASE_ASK_S_MAX)
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("node %s is not told of a release: %s", node, problem)
