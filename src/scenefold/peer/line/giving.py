"""The giver's side of a handover: offered, released, given, done (specs/12-line.md, Steps and Copying).

One task tends each side of the node. All that it goes by is the durable holding: a handover that `give` has begun and
one that a restarted node finds look the same to it. Until the release it may give up; afterwards it goes on until the
receiver has answered, or the log has removed that: then it takes back what it has released.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.telling import claim_of
from scenefold.peer.line.copying import Copier
from scenefold.peer.line.ends import Side, is_end_of, without
from scenefold.peer.line.gate import Touched
from scenefold.peer.line.holding import Handover, Holding, Step, describe, handover_id
from scenefold.peer.line.parts import Parts, check_reply
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.line.rightful import NO_COPIES, layout_of
from scenefold.peer.line.rules import neighbour_on
from scenefold.store import Counts
from scenefold.wire import ClaimRange, DropHandover, HandoverReply, OfferRange
from scenefold.world import Priority

ASK_S_MAX = 5.0
PASSES_MAX = 4
"""Passes before the piece is frozen, however much is written meanwhile."""
LITTLE_RECORDS = 64
LITTLE_BYTES = 1024 * 1024
"""A pass that brought so little: the next one is short enough for writers to wait."""
FREEZE_S_MAX = 1.5
"""Writers wait for 2 s before they are sent away: the last pass is given up before that."""
FREEZES_MAX = 5
TRIES_MAX = 6
"""Of an offer without an answer: some 16 s with the pauses between them."""
DELETE_BATCH = 256
SALT_BYTES = 8

_log = logging.getLogger("scenefold.peer.line")


@dataclass(slots=True, eq=False)
class _Waiting:
    """A caller of `give`, until the piece is the receiver's, or will not be."""

    done: trio.Event = field(default_factory=trio.Event)
    problem: ScenefoldError | None = None

    def finish(self, problem: ScenefoldError | None = None) -> None:
        self.problem = problem
        self.done.set()


class Giving:
    """Used from the Trio thread only. `tend` must run for both sides, or `give` waits for ever."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._waiting: dict[bytes, _Waiting] = {}

    async def give(self, side: Side, piece: Arc, why: str) -> None:
        """Hand an end of the arc to the neighbour on that side; returns once that owns it durably.

        Refused, Unreachable or PeerFault: the piece is still ours, but for a neighbour that falls silent after the release.
        """
        parts = self._parts
        parts.require_lease()
        peer = neighbour_on(parts.cluster_log.registry, parts.own.me, side)
        settles_in_s = parts.settling.settles_in_s(piece)
        if settles_in_s:
            raise Refused(RejectReason.BUSY, f"what was received lately stays: wait {settles_in_s:.1f} s")
        if not parts.keeper.copies.is_recovered(piece):
            raise Refused(RejectReason.BUSY, "not all is known yet that was acknowledged there: it is being asked for")
        salt = parts.world.entropy.token(SALT_BYTES)

        def offer(holding: Holding) -> Holding:
            return holding.offer(handover_id(holding.revision + 1, salt), side, peer, piece)

        offered = (await parts.keeper.change(offer)).on(side)
        assert offered is not None
        # Nothing was awaited since the commit, so whoever tends this side has not seen it yet.
        waiting = self._waiting[offered.id] = _Waiting()
        _log.info("the piece %s..%s is offered to %s: %s", piece.first.hex()[:8], piece.last.hex()[:8], address_of(peer.node), why)
        await waiting.done.wait()
        if waiting.problem is not None:
            raise waiting.problem

    async def tend(self, side: Side) -> None:
        """Go on with whatever this node gives on that side, until cancelled."""
        keeper = self._parts.keeper
        pauses = Pauses(self._parts.world)
        current: bytes | None = None
        while True:
            revision = keeper.holding.revision
            handover = keeper.holding.on(side)
            if handover is None or not handover.gives:
                self._dismiss_gone()
                await keeper.changed_after(revision)
                continue
            if handover.id != current:
                current = handover.id
                pauses.reset()
            try:
                await self._try(side, handover, pauses.count)
                pauses.reset()
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("%s: %s", describe(handover), problem)
                await pauses.wait()

    async def _try(self, side: Side, handover: Handover, tries: int) -> None:
        """One more try to go on. An offer that cannot is withdrawn; what was released is only ever tried again."""
        try:
            await self._go_on(side, handover)
        except (Refused, Unreachable, PeerFault) as problem:
            if handover.step is Step.OFFERED and _is_final(problem, tries):
                await self._withdraw(handover, problem)
                return
            if handover.step is not Step.OFFERED and tries == TRIES_MAX:
                _log.warning("%s cannot go on yet: %s", describe(handover), problem)
                self._answer(handover.id, problem)
            raise

    async def _go_on(self, side: Side, handover: Handover) -> None:
        match handover.step:
            case Step.OFFERED:
                await self._offer(side, handover)
            case Step.RELEASED if self._parts.keeper.is_removed(handover.peer):
                await self._take_back(handover)
            case Step.RELEASED:
                await self._claim(handover)
            case _:
                await self._delete(side, handover)

    # --------------------------------------------------------------------------------------------- until release

    async def _offer(self, side: Side, handover: Handover) -> None:
        parts = self._parts
        parts.require_lease()
        if neighbour_on(parts.cluster_log.registry, parts.own.me, side) != handover.peer:
            raise Refused(RejectReason.OUTSIDE_BOUNDS, "the receiver is our neighbour no more")
        await self._slide(side, handover)
        totals = await parts.store.arc_totals(handover.piece)
        await self._ask_to_note(handover, totals)
        await parts.knowing.ensure(handover.peer)
        await self._copy(side, handover)

    async def _ask_to_note(self, handover: Handover, totals: Counts) -> None:
        """Have the receiver say, under its lease and its incarnation, that it is ready to take the piece."""
        parts, piece = self._parts, handover.piece
        position = parts.cluster_log.registry.position
        check_reply(
            await self._ask(
                handover,
                OfferRange(handover.id, parts.own.member, handover.peer, piece.first, piece.last, totals.records, totals.bytes, position),
            )
        )

    async def _slide(self, side: Side, handover: Handover) -> None:
        """Node-managed records lie on the side of the bound to be that their homes are on: what does not, slides."""
        parts = self._parts
        while await parts.store.parted(handover.piece):
            async with parts.keeper.unchanging() as holding:
                if holding.arc is None or holding.on(side) != handover:
                    return
                rest = without(holding.arc, handover.piece, side)
                other = holding.on(side.opposite)
                if rest is not None and other is not None and other.step is Step.OFFERED:
                    # What goes to the other neighbour may be frozen, and must not grow behind its last copies.
                    rest = without(rest, other.piece, side.opposite) if is_end_of(other.piece, rest, side.opposite) else None
                if not await parts.store.slide([handover.piece, *([] if rest is None else [rest])]):
                    return

    async def _copy(self, side: Side, handover: Handover) -> None:
        parts = self._parts
        copier = Copier(parts, handover)
        for _ in range(PASSES_MAX):
            sent = await copier.copy()
            if sent.records <= LITTLE_RECORDS and sent.bytes <= LITTLE_BYTES:
                break
        pauses = Pauses(parts.world)
        outer = handover.piece.first if side is Side.LEFT else handover.piece.last
        for _ in range(FREEZES_MAX):
            await self._slide(side, handover)
            with parts.gate.watched(handover.piece, outer) as touched:
                # This pass meets all that was written before the watch, so the last one need only look where it says.
                await parts.keeper.flush()
                await copier.copy()
                await parts.world.clock.sleep(parts.settling.settles_in_s(handover.piece))
                async with parts.gate.frozen(handover.piece):
                    if await self._complete(handover, copier, touched):
                        await self._release(handover)
                        return
            parts.events["thawed"] += 1
            await pauses.wait()
        raise Refused(RejectReason.BUSY, "too much is written to the piece: its last copies took too long")

    async def _complete(self, handover: Handover, copier: Copier, touched: Touched) -> bool:
        """Bring the last changes of a frozen piece; False if writers would have to wait for too long."""
        with trio.move_on_after(FREEZE_S_MAX):
            await self._parts.gate.drained(handover.piece)
            await self._parts.keeper.flush()
            if await self._parts.store.parted(handover.piece):
                # One of which the home was taken has come to lie on the other side meanwhile: it slides first.
                return False
            if self._parts.unsettled.within(handover.piece):  # Its receiver knows nothing of who has what.
                return False
            await copier.copy(only=touched.pieces, hurry=True)
            # Once more, since a receiver whose disk was wiped or rolled back meanwhile has answered for what it has no more.
            await self._ask_to_note(handover, Counts())
            return True
        return False

    async def _release(self, handover: Handover) -> None:
        self._parts.require_lease()

        def released(holding: Holding) -> Holding:
            # Whoever owns it next goes by no older header than this node did.
            self._parts.knowing.require(handover.peer)
            return holding.release(handover.id)

        await self._parts.keeper.change(released)
        self._parts.events["released"] += 1

    async def _withdraw(self, handover: Handover, problem: ScenefoldError) -> None:
        await self._parts.keeper.change(lambda holding: holding.withdraw(handover.id))
        self._parts.events["withdrawn"] += 1
        _log.info("%s is withdrawn: %s", describe(handover), problem)
        self._answer(handover.id, problem)
        try:
            await self._ask(handover, DropHandover(handover.id))
        except (Refused, Unreachable, PeerFault) as silence:
            # The receiver asks by itself what became of it.
            _log.debug("%s: the receiver was not told: %s", describe(handover), silence)

    # --------------------------------------------------------------------------------------------- after release

    async def _claim(self, handover: Handover) -> None:
        keeper, piece = self._parts.keeper, handover.piece
        check_reply(await self._ask(handover, claim_of(handover.id, piece, keeper.copies.passed(handover.id))))
        await keeper.change(lambda holding: holding.confirm(handover.id, keeper.is_removed))
        self._parts.events["given"] += 1
        self._answer(handover.id)

    async def _take_back(self, handover: Handover) -> None:
        """Own the piece again, once its receiver cannot speak for it any more, whether it had claimed or not."""
        parts, keeper, piece = self._parts, self._parts.keeper, handover.piece
        removal = parts.cluster_log.registry.removal(handover.peer.incarnation)
        assert removal is not None
        await parts.world.clock.sleep(parts.leases_end_in_s(removal.position))
        parts.require_lease()
        # Like a piece that was received: noted before anybody can be told that it is here, and once more when it is.
        parts.settling.note(piece)
        await keeper.change(lambda holding: holding.take_back(handover.id, keeper.is_removed))
        parts.settling.note(piece)
        parts.events["taken back"] += 1
        _log.info(
            "the piece %s..%s is this node's again: %s was removed",
            piece.first.hex()[:8],
            piece.last.hex()[:8],
            address_of(handover.peer.node),
        )
        self._answer(handover.id, Unreachable("the receiver was removed from the cluster; the piece is here again"))

    async def _delete(self, side: Side, handover: Handover) -> None:
        cursor: bytes | None = None
        while True:
            # The holding stands still meanwhile, or a piece that comes back could lose what has come with it.
            async with self._parts.keeper.unchanging() as holding:
                if holding.on(side) != handover:
                    return
                manifest = await self._parts.store.manifest(handover.piece, cursor, DELETE_BATCH)
                theirs = [entry for entry in manifest.entries if entry.home in handover.piece and not holding.owns(entry.home)]
                # What has copies this node may be about to hold: it stays, as a stray until it is told so.
                gone = [(entry.spot, entry.digest) for entry in theirs if await layout_of(self._parts, *entry.place[:2]) == NO_COPIES]
                if gone:
                    await self._parts.store.remove(gone)
            cursor = manifest.cursor
            if cursor is None:
                break
        check_reply(await self._ask(handover, DropHandover(handover.id)))
        await self._parts.keeper.change(lambda now: now.finish(handover.id))

    # -------------------------------------------------------------------------------------------------- helpers

    async def _ask(self, handover: Handover, request: OfferRange | ClaimRange | DropHandover) -> HandoverReply:
        return await self._parts.peers.ask(handover.peer.node, Priority.LOW, request, HandoverReply, ASK_S_MAX)

    def _answer(self, handover: bytes, problem: ScenefoldError | None = None) -> None:
        waiting = self._waiting.pop(handover, None)
        if waiting is not None:
            waiting.finish(problem)

    def _dismiss_gone(self) -> None:
        """Tell callers whose handover has ended without us: the log has removed the receiver."""
        holding = self._parts.keeper.holding
        for handover in [known for known in self._waiting if holding.find(known) is None]:
            self._answer(handover, Unreachable("the receiver was removed from the cluster"))


def _is_final(problem: ScenefoldError, tries: int) -> bool:
    """Whether an offer is given up. A receiver without a lease, or that is away, may be back in a moment."""
    if isinstance(problem, Refused) and problem.reason is not RejectReason.NOT_READY:
        return True
    return tries >= TRIES_MAX
