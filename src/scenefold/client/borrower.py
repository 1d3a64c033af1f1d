"""One lease that a client borrows, of one scene and for one key: asked for, renewed, given back (specs/26-modes.md, Lent leases).

What holds when is `Loan`'s (borrowing.py); here are the clock, the participants and the signature. Each participant is asked over a connection
of its own: nobody signs the answer, so that of a relay would count for nothing.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import NoLease, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, SpaceId, address_of
from scenefold.base.limits import CLIENT_ASKED_MAX, LEASE_LOOK_S
from scenefold.base.reasons import RejectReason
from scenefold.client.borrowing import LENT_S_MAX, Loan
from scenefold.client.hedging import first_answer
from scenefold.crypto import LEASE_DOMAIN, SigningKey
from scenefold.scene.head import was_edited
from scenefold.wire import BorrowLease, LeaseUse, LentLease, SceneMode
from scenefold.world import Priority

if TYPE_CHECKING:
    from scenefold.client.access import SceneAccess
    from scenefold.client.leases import Leases
    from scenefold.client.sealing import SceneIdentity

LEND_S_MAX = 20.0
"""A write waits so long for a lease: longer than a change of mode takes to become active, and than a participant is without one of its own."""
LEND_ASK_S = 5.0
"""For one participant to answer; it may have to ask the others first."""
LEND_NEXT_S = 2.5
"""Of silence, after which the next one is asked as well."""
PAUSE_S = 0.5
RETURN_S = 2.0
MODES = {LeaseUse.EDIT: SceneMode.EDIT, LeaseUse.RENDER: SceneMode.RENDER}
_HELD_UP = (RejectReason.MODE_FORBIDS, RejectReason.NOT_READY, RejectReason.UNKNOWN_SCENE_OR_SPACE)
"""What participants say that have no lease themselves, or know less of the scene than we do."""

_Problems = dict[NodeId, ScenefoldError]
"""Why each participant that was asked has lent nothing."""

_log = logging.getLogger("scenefold.client.leases")


class Borrowing:
    """Used from the Trio thread only."""

    def __init__(self, leases: Leases, access: SceneAccess, key: SigningKey, use: LeaseUse, process: bytes) -> None:
        """`use`: EDIT or RENDER. `process`: what this client drew for that."""
        self._leases, self._calls, self._access, self._key = leases, leases.calls, access, key
        self._use, self._process = use, process
        self.loan = Loan()
        self._changed = trio.Event()
        self._asking = trio.Lock()
        self._last: NodeId | None = None
        self._is_kept = False

    def _now(self) -> float:
        return self._calls.world.clock.now()

    def _set(self, loan: Loan) -> None:
        self.loan = loan
        self._changed.set()
        self._changed = trio.Event()

    def may_sign(self, identity: SceneIdentity) -> bool:
        held = self.loan.held
        return held is not None and held.position <= identity.position and self.loan.may_sign(identity.write_floor, self._now())

    def ends(self) -> None:
        self._set(self.loan.ends(self._now()))

    # --------------------------------------------------------------------------------------------------- for writes

    async def begin(self, access: SceneAccess, needs: Collection[SpaceId]) -> None:
        """As `hold`, for a call that has nothing under way yet; it counts from then on, until it `ends`."""
        await self._held(access, needs, self._may_begin)
        self._set(self.loan.begins())

    async def hold(self, access: SceneAccess, needs: Collection[SpaceId]) -> None:
        """Return once the scene as `access` knows it may be signed for, nothing being awaited between."""
        await self._held(access, needs, self._may_sign)

    def _may_begin(self, floor: int) -> bool:
        return self.loan.may_begin(floor, self._now())

    def _may_sign(self, floor: int) -> bool:
        return self.loan.may_sign(floor, self._now())

    async def _held(self, access: SceneAccess, needs: Collection[SpaceId], is_held: Callable[[int], bool]) -> None:
        self._access = access
        until, problems = trio.current_time() + LEND_S_MAX, _Problems()
        while True:
            identity = access.identity
            self._check_mode(identity, needs, access.name)
            if is_held(identity.write_floor) and self.may_sign(identity):
                return
            held = self.loan.held
            if held is not None and is_held(identity.write_floor):
                # Whoever acts by it is to know what it is of; records show that.
                await access.refresh(held.position)
                if access.identity.position >= held.position:
                    continue
            else:
                problems = await self._ask(identity, is_held) or problems
                if is_held(access.identity.write_floor):
                    continue
                if any(isinstance(problem, Refused) for problem in problems.values()):
                    # What they refuse we may not know yet: another mode, or that our access was revoked.
                    await access.refresh()
                    access.check_writer()
                    self._check_mode(access.identity, needs, access.name)
            if trio.current_time() >= until:
                raise _no_lease(access, problems, self._use)
            await self._calls.world.clock.sleep(PAUSE_S)

    def _check_mode(self, identity: SceneIdentity, needs: Collection[SpaceId], name: str) -> None:
        """Refused (9) if the scene's mode, by what is known of it, forbids what the lease is for."""
        if self._use is LeaseUse.EDIT:
            identity.check_mode(needs, name)
        elif identity.mode is not SceneMode.RENDER:
            raise was_edited(f"scene {name}")

    @property
    def holds(self) -> bool:
        """Whether anything may be done by it now."""
        held = self.loan.held
        return held is not None and self.loan.may_sign(held.position, self._now())

    async def lost(self) -> None:
        """Return once nothing may be done by it any more. Of a machine that slept it is noticed some time after it woke; `holds` says it at once."""
        while (held := self.loan.held) is not None and self.holds:
            changed = self._changed
            with trio.move_on_after(min(held.until - self._now(), LEASE_LOOK_S)):
                await changed.wait()

    # ------------------------------------------------------------------------------------------------------- asking

    async def _ask(self, identity: SceneIdentity, is_held: Callable[[int], bool]) -> _Problems:
        """One round of asking participants, who lent last time first; why each of them did not, if none did."""
        async with self._asking:
            if is_held(identity.write_floor) or not self.loan.may_ask(self._now()):
                return {}
            problems = _Problems()
            last, silent, turn = self._last, self._calls.is_silent, self._calls.world.entropy.uniform()
            first = int(turn * len(identity.deciders))
            order = identity.deciders[first:] + identity.deciders[:first]
            tries = [
                partial(self._ask_one, node, identity, problems) for node in sorted(order, key=lambda node: (node != last, silent(node)))
            ]
            try:
                await first_answer(tries, next_after_s=LEND_NEXT_S, at_a_time=CLIENT_ASKED_MAX, refusal_counts=False)
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("no lease of scene %08x: %s", identity.scene, problem)
                return problems
            return {}

    async def _ask_one(self, node: NodeId, identity: SceneIdentity, problems: _Problems) -> None:
        asked_at = self._now()
        self._set(self.loan.asks(node, asked_at))
        # Here, where nothing is waited for between: who keeps it ends as soon as nobody holds anything for us.
        self._is_kept = self._is_kept or self._leases.start(self._keep)
        try:
            lent = await self._said(node, self._use, LEND_ASK_S)
            self._check(lent, node, identity)
        except (Refused, Unreachable, PeerFault) as problem:
            problems[node] = problem
            raise
        self._last = node
        left_s = lent.left_ms / 1000
        # A render that has begun is not cut: whoever wants to edit waits for its end.
        is_asked_back = lent.is_asked_back and self._use is LeaseUse.EDIT
        self._set(self.loan.lent(lent.position, left_s, asked_at, self._now(), is_asked_back=is_asked_back))

    def _check(self, lent: LentLease, node: NodeId, identity: SceneIdentity) -> None:
        """PeerFault for what no participant lends; Refused (16) if it knows less of the scene than is known here."""
        if lent.mode is not MODES[self._use] or not lent.is_active or not 0 < lent.left_ms <= LENT_S_MAX * 1000:
            raise PeerFault("what is lent is no lease of the kind that was asked for", where=address_of(node))
        if lent.position < identity.write_floor:
            raise Refused(RejectReason.NOT_READY, "the participant does not know the scene's newest entries yet", where=address_of(node))

    async def _said(self, node: NodeId, use: LeaseUse, within_s: float) -> LentLease:
        identity, nonce = self._access.identity, self._leases.next_nonce()
        plain = BorrowLease(identity.scene, identity.genesis, use, nonce, node, self._key.key_id, self._process)
        signature = await self._calls.world.workers.run("crypto", self._key.sign, LEASE_DOMAIN, plain.signable())
        packet = replace(plain, signature=signature)
        lent = await self._calls.ask(address_of(node), packet, LentLease, priority=Priority.HIGH, timeout_s=within_s)
        if (lent.nonce, lent.lender) != (nonce, node):
            raise PeerFault("another question for a lease is answered", where=address_of(node))
        return lent

    # ------------------------------------------------------------------------------------------------------ keeping

    async def _keep(self) -> None:
        """Until nobody holds anything for us."""
        try:
            while self.loan.lenders:
                now = self._now()
                renews_at, returns_at = self.loan.renews_at(now), self.loan.returns_at
                if min(renews_at, returns_at) > now:
                    with trio.move_on_after(min(renews_at, returns_at) - now):
                        await self._changed.wait()
                elif returns_at <= now:
                    await self.give_back(if_idle=True)
                else:
                    identity = self._access.identity
                    await self._ask(identity, lambda _: self.loan.renews_at(self._now()) > self._now())
        finally:
            self._is_kept = False

    async def give_back(self, *, if_idle: bool = False) -> None:
        """Whatever may be held for us, if nothing is under way; `if_idle`: and nothing was for a while, or it is asked back."""
        async with self._asking:
            lenders = self.loan.lenders
            if self.loan.writes or not lenders or (if_idle and self.loan.returns_at > self._now()):
                return
            self._set(self.loan.given_back())
            async with trio.open_nursery() as nursery:
                for node in lenders:
                    nursery.start_soon(self._give_back_to, node)

    async def _give_back_to(self, node: NodeId) -> None:
        try:
            await self._said(node, LeaseUse.GIVE_BACK, RETURN_S)
        except (Refused, Unreachable, PeerFault) as problem:
            # It runs out there by itself.
            _log.debug("a lease is not given back to %s: %s", address_of(node), problem)


def _no_lease(access: SceneAccess, problems: _Problems, use: LeaseUse) -> Refused:
    """In words, with the reason that says most of those for which participants lent nothing."""
    deciders = access.identity.deciders
    where = f"scene {access.name}; {_by_reason(deciders, problems)}"
    done, kind = ("written to the scene", "edits") if use is LeaseUse.EDIT else ("rendered of the scene", "renders")
    refused = [problem for problem in problems.values() if isinstance(problem, Refused)]
    for problem in refused:
        if problem.reason is RejectReason.BUSY:
            what = f"nothing is {done} just now: somebody changes its mode, or too many hold leases of it"
            return NoLease(RejectReason.BUSY, what, where=where, remedy="try again in a while")
    # Who began anew, and takes no part any more, says what all say of a key that may not write.
    is_of_us = len(refused) == len(problems) and all(problem.reason is RejectReason.NOT_AUTHORISED for problem in refused)
    for problem in refused:
        if problem.reason not in _HELD_UP and (is_of_us or problem.reason is not RejectReason.NOT_AUTHORISED):
            return problem
    what = (
        f"nothing can be {done} now: none of the {len(deciders)} nodes that decide it lends a lease for {kind}; "
        f"{len(deciders) // 2 + 1} of them must hear each other"
    )
    remedy = f"start those that are down, or wait until the network is whole, and repeat it; nothing was {done.split()[0]}"
    return NoLease(RejectReason.MODE_FORBIDS, what, where=where, remedy=remedy)


def _by_reason(deciders: Sequence[NodeId], problems: _Problems) -> str:
    """Who lent nothing, and why: `10.0.0.2, 10.0.0.3: mode forbids; 10.0.0.4: no answer`."""
    alike: dict[str, list[str]] = {}
    for node in deciders:
        problem = problems.get(node)
        if isinstance(problem, Refused):
            why = problem.reason.name.lower().replace("_", " ")
        else:
            why = "a wrong answer" if isinstance(problem, PeerFault) else "no answer"
        alike.setdefault(why, []).append(address_of(node))
    return "; ".join(f"{', '.join(nodes)}: {why}" for why, nodes in alike.items())
