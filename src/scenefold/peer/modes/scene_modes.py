"""The leases of one scene at a node that decides its log: asked for, granted, and what the log has to know of them (specs/26-modes.md).

Leases are asked for only while somebody wants to act by one. What hangs together how is `Standing`'s; here are the clock, the other nodes and
the signatures. Nothing here waits between a look at `standing` and what is said by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide, Judge, Slot, Value
from scenefold.peer.logs.ports import Owner
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.asking import GRANT, Asking
from scenefold.peer.modes.granter import Verdict
from scenefold.peer.modes.header_votes import shown_by_header
from scenefold.peer.modes.lender import Borrower
from scenefold.peer.modes.own_use import OwnUse
from scenefold.peer.modes.packets import check_proof
from scenefold.peer.modes.scene import DecidedScene
from scenefold.peer.modes.standing import Standing
from scenefold.peer.modes.switch_story import SwitchStory, key_of
from scenefold.peer.peers import Peers
from scenefold.peer.scene_log.scene_judge import SceneJudge
from scenefold.peer.timing import T_WAIT_S
from scenefold.peer.waiters import Waiters
from scenefold.scene.log import opened_value
from scenefold.wire import (
    MalformedPacket,
    Member,
    Packet,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    SceneMode,
)
from scenefold.world import World

ASKED_BACK_S = 5.0
"""Who is told that a lease is asked back settles what it has signed, and gives it back; nobody else is lent anything meanwhile."""
LOOK_S = 0.1
_NOBODY = bytes(16)


class SceneModes(Owner):
    """Used from the Trio thread only. `behind` is called when somebody knows more of the log than this node."""

    def __init__(
        self, world: World, peers: Peers, own: OwnStatus, public: SceneLogPublic, behind: Callable[[], object], *, is_new: bool = False
    ) -> None:
        """`is_new`: this node never decided this log in a life before this one."""
        self._world, self._own, self._behind = world, own, behind
        self.news = Waiters()
        """Whatever changes here, but for the time."""
        self.own_use = OwnUse(self, world)
        """What this node does by its own lease, where it observes."""
        self._asking = Asking(self, world, peers, own, behind)
        self._story = SwitchStory(self, world, peers, own, public)
        self.begins_at(public, is_new=is_new)

    def begins_at(self, public: SceneLogPublic, *, is_new: bool = False) -> None:
        """The scene as this node knows it at a start, or behind positions that it never learnt."""
        self.public = public
        was_switched = public.mode is not SceneMode.EDIT or public.write_floor > 0
        me, scene = self._own.member, DecidedScene.of(public)
        # Who observes held nothing before its start that it holds now, and may say so at once.
        released = public.position if was_switched and me in scene.observers else 0
        started = Standing.started(me, scene, self._now(), released=released, was_switched=was_switched, may_have_lent=not is_new)
        # It says nothing before it is known what it has voted for (`stands`).
        self.standing = replace(started, speaker=Member(self._own.me, _NOBODY))
        self._story.forget(public)
        if released and (decided := shown_by_header(public, public)) is not None:
            self._story.released(decided)
        self._asking.forget()
        self._asked_back_until = self._cut_until = -1.0
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
        await self._until(lambda: self.acts_in is not None, within_s)
        return self.acts_in

    async def may_act(self, mode: SceneMode, within_s: float) -> bool:
        """Whether this node may begin to act in this mode; it waits so long for that. While the mode is about to change nobody begins."""

        def may() -> bool:
            return self.acts_in is mode and self._now() >= self._asked_back_until

        await self._until(may, within_s)
        return may()

    @property
    def acts_in(self) -> SceneMode | None:
        """The mode that this node may act in at this moment."""
        return self.standing.acts_in(self._now())

    def want(self) -> None:
        """A lease is wanted for some time on."""
        self._asking.wants()

    async def leased(self, within_s: float) -> bool:
        """Whether this node holds a lease, whatever mode is active; it waits so long for one."""
        await self._until(lambda: self.standing.holder.lease(self._now()) is not None, within_s)
        return self.standing.holder.lease(self._now()) is not None

    async def _until(self, holds: Callable[[], bool], within_s: float) -> None:
        self._asking.wants()
        with trio.move_on_after(within_s):
            while not holds():
                # Time alone may make a mode active, and nobody tells of it.
                with trio.move_on_after(LOOK_S):
                    await self.news.until(holds)

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
        # A render that has begun is not cut, unless somebody insists; who edits comes to an end.
        comes_to_end = is_asked_back and (mode is SceneMode.EDIT or now < self._cut_until)
        self.standing, left_s = self.standing.lends(borrower, now, no_more=comes_to_end)
        return left_s, is_asked_back

    def take_back(self, borrower: Borrower, nonce: int) -> None:
        """The client uses it no more."""
        self._check_nonce(borrower, nonce)
        self.standing = self.standing.given_back(borrower)
        self.news.tell()

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
        key = key_of(member, self.public)
        if key is not None:
            await self._world.workers.run("crypto", partial(check_proof, key, packet, member))
        verdict = self.standing.judges(member, packet.have)
        if verdict in (Verdict.STRANGER, Verdict.SILENT):
            who = "the asker" if verdict is Verdict.STRANGER else "this node"
            raise Refused(RejectReason.NOT_AUTHORISED, f"{who} takes no part in the scene's next position")
        if verdict is Verdict.NOT_HERE_YET and key is not None:
            # Else nobody has signed how far it is: a stranger's word makes this node ask nobody.
            self._behind()
        flags = GRANT if verdict is Verdict.GRANT else 0
        return RespondSceneLog(SceneLogAnswer(packet.nonce, flags, self.public.position, self.public, None))

    def shown(self, packet: Packet) -> None:
        """A packet about this log: votes and releases in it may make the mode active."""
        self._story.shown(packet)
        self.news.tell()

    @property
    def is_live(self) -> bool:
        """Whether something that this node lent, now or before its start, may still be used."""
        return self.standing.lender.is_live(self._now())

    def ask_back(self) -> None:
        """The mode is about to change. Nothing new is lent either, for as long as a pass takes: else an editor who was asked by one participant goes on
        with the next."""
        self._asked_back_until = max(self._asked_back_until, self._now() + ASKED_BACK_S)

    def check_proposal(self, public: SceneLogPublic, *, forced: bool = False) -> None:
        """Refused (13) if this node itself must not vote for what is asked for here. `forced`: it is proposed all the same, and voted for later."""
        is_switch = public.mode is not self.public.mode
        if is_switch and forced:
            self._insist()
        elif is_switch:
            self.ask_back()
        if not forced and self.standing.abstains(is_switch=is_switch, now=self._now()):
            what = "leases that this node lent, now or before its start, may still be used"
            raise Refused(RejectReason.BUSY, what, remedy=f"try again in {T_WAIT_S:.0f} s, or at another participant")

    # ------------------------------------------------------------------------------------------------- for the log

    def veto(self, value: Value | None) -> RejectReason | None:
        """13 against a change of the mode, as `check_proposal` says it: what was lent before a start is minded as what is lent now."""
        if value is None or not self._is_switch(value):
            return None
        self.ask_back()
        return RejectReason.BUSY if self.is_live else None

    def insisted(self, value: Value) -> None:
        if self._is_switch(value):
            self._insist()

    def _insist(self) -> None:
        """What is lent runs out, renders' leases too: until then nothing is lent or renewed."""
        self._asked_back_until = self._cut_until = self._now() + T_WAIT_S

    def abstains(self, value: Value) -> bool:
        return self.standing.abstains(is_switch=self._is_switch(value), now=self._now())

    def votes(self, value: Value) -> None:
        is_switch = self._is_switch(value)
        if self.standing.abstains(is_switch=is_switch, now=self._now()):
            # Lent since this node was asked, or it is its own proposal: nobody asks it then.
            raise Refused(RejectReason.BUSY, "something that was lent may still be used")
        self.standing = self.standing.votes(is_switch=is_switch)

    def stands(self, slot: Slot, *, is_silent: bool) -> None:
        speaker = Member(self._own.me, _NOBODY) if is_silent else self._own.member
        accepted = None if slot.accepted is None else self._after(slot.accepted.value)
        self.standing = self.standing.stands(accepted, speaker)
        self.news.tell()

    def decided(self, decided: Decide, after: Judge) -> None:
        assert isinstance(after, SceneJudge)
        self._follow(after.public, decided)
        self.news.tell()

    def learnt(self, public: SceneLogPublic) -> None:
        """A later header was decided, and is durable here; of those between, if there are any, nothing is known."""
        before, decided = self.public, shown_by_header(public, self.public)
        if public.position == before.position + 1 and decided is not None:
            self._follow(public, decided)
        else:
            was_switched = public.mode is not before.mode or public.write_floor != before.write_floor
            self.standing = self.standing.jumped(DecidedScene.of(public), self._now(), was_switched=was_switched)
            self.public = public
            if was_switched:
                self._end_asking_back()
                self._story.forget(public)
                if decided is not None and self.standing.releases.own:
                    self._story.released(decided)
        self.news.tell()

    def _follow(self, public: SceneLogPublic, decided: Decide) -> None:
        """The next position is decided, durably."""
        before, proof = self.public, decided.certificate
        votes = self._story.true_votes(proof.votes, proof, decided.value, before)
        scene = DecidedScene.of(public)
        is_switch = self.standing.scene.is_switched_by(scene)
        self.standing = self.standing.decided(scene, decided.value.digest, proof.ballot, votes, self._now())
        self.public = public
        self._end_asking_back(within_s=0.0 if is_switch else ASKED_BACK_S)
        if is_switch:
            self._story.switched(before, decided)

    def _end_asking_back(self, within_s: float = 0.0) -> None:
        self._cut_until = -1.0
        self._asked_back_until = min(self._asked_back_until, self._now() + within_s)

    def _after(self, value: Value) -> DecidedScene:
        """What the scene would be with it."""
        try:
            return DecidedScene.of(opened_value(value).public)
        except MalformedPacket:
            # The judge has refused it; nobody takes part by it.
            return DecidedScene(self.public.position + 1, self.public.mode, frozenset())

    def _is_switch(self, value: Value) -> bool:
        return self._after(value).mode is not self.public.mode

    # -------------------------------------------------------------------------------------------------------- task

    async def run(self) -> None:
        """Until cancelled: ask for leases while somebody wants them, and say of a switch what may be said."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._asking.run)
            nursery.start_soon(self._story.run)
