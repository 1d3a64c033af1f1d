"""What is written here comes to all who hold copies of it, and counts once enough of them have it (specs/20-copies.md, Writes).

The owner stores a record together with who is still to get it, sends it to all of them at once (lane.py), and waits for as many as
the rules ask for (judging.py). What is not settled by then stays unsettled: nobody is told of it before it is, and it is sent on.
What is settled and not everywhere is a debt that is paid beside all else (paying.py).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SceneId, SpaceId, address_of
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordPlace, object_of
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Name, Pending, first_unsettled, name_of
from scenefold.peer.membership.roster import Roster
from scenefold.peer.records.copying import TOLD_S_MAX, NotKept
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.replication.beginning import Beginning
from scenefold.peer.replication.full_holders import FullHolders
from scenefold.peer.replication.judging import Judging
from scenefold.peer.replication.lane import item_of
from scenefold.peer.replication.settling import Settled
from scenefold.peer.replication.settling_rule import Rule
from scenefold.store import Outcome, Put, PutResult, Spot
from scenefold.store.versions import version_of
from scenefold.world import QuietLog

ANSWER_S_MAX = 10.0
"""How long a write waits for its holders, all in all."""
PENDING_MAX = 65_536
"""Versions that are unsettled at a time; beyond it nothing more is taken."""

_Space = tuple[SceneId, SpaceId]

_log = logging.getLogger("scenefold.peer.replication")


class Places(Protocol):
    """Who holds copies of what (placing.py)."""

    @property
    def full(self) -> FullHolders:
        """Who has no room."""
        ...

    def check(self, scene: KnownScene, space: SpaceId, /) -> None:
        """Refused (22) if so few nodes may hold copies of the space that no write can count."""
        ...

    async def ensure_placed(self, layout: Layout, /) -> None:
        """Return once every place of the arc has holders. Refused (16) if that takes long."""
        ...


class _Wait(NamedTuple):
    """The answer to this put waits for these. `about`: it only speaks of what is there, and did not store anything."""

    which: int
    pendings: Sequence[Pending]
    about: Spot | None = None


class Spreading:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, roster: Roster, places: Places) -> None:
        self._parts = parts
        self._judging = Judging(parts, roster, places.full)
        self._places = places
        self._unsettled = parts.unsettled
        self._settled = Settled(parts, self._judging)
        self.records_settled = self._settled.records
        self.list_settled = self._settled.listed
        self._quiet = QuietLog(_log, logging.INFO)
        parts.keeping.merge = self.merge

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Send, pay and judge until cancelled. Started when it is known what may not be told: before anybody can ask."""
        beginning = Beginning(self._parts, self._judging)
        beginning.begin()
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._judging.run)
            nursery.start_soon(beginning.run)
            task_status.started()

    def in_hand(self, name: Name) -> bool:
        """Whether there is a version of a record in memory that may still be sent to holders, whatever lies on the disk by now."""
        return self._judging.in_hand(name)

    def is_bound(self, scene: SceneId, space: SpaceId, arc: Arc) -> bool:
        """Whether somebody may still be answered there by a layout that the space had before."""
        return bool(self._judging.turning.binding(scene, space, arc))

    def doubt(self, arc: Arc) -> None:
        """Nobody knows who has what there, as of a gap: it is unsettled until each place satisfies both rules by who is sound."""
        self._judging.doubt(arc)

    async def put(self, puts: Sequence[Put], scenes: Mapping[SceneId, KnownScene]) -> list[PutResult | NotKept]:
        """Store verified records of clients, and return once they are settled, or will not be soon."""
        return await self._keep(puts, scenes, is_new=True, wait=True)

    async def merge(self, puts: Sequence[Put], *, wait: bool = True) -> list[PutResult | NotKept]:
        """Take verified copies into this node's own arc. They settle like puts; without `wait` they may be unsettled on return.

        What others have already is taken also if too few are there for it to settle: it is safer here than nowhere else.
        """
        scenes = {scene: await self._parts.scenes.known(scene) for scene in sorted({put.record.header.scene for put in puts})}
        return await self._keep(puts, scenes, is_new=False, wait=wait)

    async def _keep(
        self, puts: Sequence[Put], scenes: Mapping[SceneId, KnownScene], *, is_new: bool, wait: bool
    ) -> list[PutResult | NotKept]:
        until = trio.current_time() + ANSWER_S_MAX
        refused = await self._place(puts, scenes, until, is_new=is_new)
        # A space may have turned since they were verified; what is given to the store by an old header would be in no comparison.
        scenes = {scene: self._parts.scenes.here(scene) or known for scene, known in scenes.items()}
        keep = self._parts.store.put if is_new else self._parts.store.merge
        outcomes: dict[int, PutResult | NotKept] = {}
        kept: list[tuple[int, Put, Pending | None]] = []
        judged: dict[tuple[Rule, int], bool] = {}
        for index, put in enumerate(puts):
            planned = self._planned(put, scenes[put.record.header.scene], refused)
            if is_new and isinstance(planned, Pending):
                planned = self._hopeful(planned, judged)
            if isinstance(planned, NotKept):
                outcomes[index] = planned
            else:
                kept.append((index, put, planned))
        # From here to the store's queue nothing is awaited: whoever becomes a holder after this look is compared after it.
        for _, _, pending in kept:
            if pending is not None:
                pending.is_write = is_new
                self._unsettled.add(pending)
        debtors = [() if pending is None else tuple(pending.debtors) for _, _, pending in kept]
        with trio.CancelScope(shield=True):
            # Cancelled half-way, nobody would know whether there is anything to settle.
            results = await keep([put for _, put, _ in kept], debtors) if kept else []
        waits: list[_Wait] = []
        repeated: list[tuple[int, Pending]] = []
        for (index, put, pending), result in zip(kept, results, strict=True):
            outcomes[index] = result
            if pending is not None:
                waits += self._stored(index, put, pending, result)
                # What nobody waits for there may be much of: it is read again when it is sent.
                pending.item = pending.item if wait else None
                if is_new and result.outcome is Outcome.STORED and not result.has_changed:
                    repeated.append((index, pending))
        if repeated:
            waits += await self._repeated(repeated)
        if wait:
            await self._wait(waits, until, outcomes)
        return [outcomes[index] for index in range(len(puts))]

    # ------------------------------------------------------------------------------------------ before it is stored

    async def _place(
        self, puts: Sequence[Put], scenes: Mapping[SceneId, KnownScene], until: float, *, is_new: bool
    ) -> dict[_Space, NotKept]:
        """Have holders for all places, and nobody who is counted no more; in which spaces none can count, and why."""
        refused: dict[_Space, NotKept] = {}
        unplaced: dict[_Space, Layout] = {}
        spaces: set[_Space] = set()
        for put in puts:
            header = put.record.header
            space = header.scene, header.space
            layout = scenes[header.scene].layouts.get(header.space, ())
            if layout:
                spaces.add(space)
                spot = _spot(put)
                rule = self._judging.rule_at(layout, spot)
                # What is being recovered gets none before it is, however long that takes.
                if (rule is None or not rule.is_placed) and self._parts.keeper.copies.is_recovered(Arc(spot.home, spot.home)):
                    unplaced[space] = layout
            elif header.space in scenes[header.scene].turns:
                with trio.CancelScope(deadline=until):
                    await self._judging.turning.freed(*space, Arc(_spot(put).home, _spot(put).home))
        for space in sorted(spaces):
            try:
                if is_new:
                    self._places.check(scenes[space[0]], space[1])
                if space in unplaced:
                    await self._places.ensure_placed(unplaced[space])
                    if is_new:
                        # Of what has only just come here nobody knew before that who may hold copies is too few.
                        self._places.check(scenes[space[0]], space[1])
            except Refused as refusal:
                self._say("no holders", f"writes are refused: {refusal}")
                refused[space] = NotKept(refusal.reason, self._parts.own.me)
        return refused

    def _planned(self, put: Put, known: KnownScene, refused: Mapping[_Space, NotKept]) -> Pending | NotKept | None:
        """What is to become of it: None if it has one copy; NotKept if nobody knows who is to hold it."""
        record = put.record
        header = record.header
        layout = known.layouts.get(header.space, ())
        if not layout:
            home = _spot(put).home
            is_bound = header.space in known.turns and self._judging.turning.binding(header.scene, header.space, Arc(home, home))
            return NotKept(RejectReason.NOT_READY, self._parts.own.me) if is_bound else None
        if (header.scene, header.space) in refused:
            return refused[header.scene, header.space]
        spot = _spot(put)
        rule = self._judging.rule_at(layout, spot)
        if rule is None or not rule.is_placed or len(self._unsettled) >= PENDING_MAX:
            return NotKept(RejectReason.NOT_READY, self._parts.own.me)
        version, needed = version_of(record.header_bytes), known.needed[header.space]
        return Pending(spot, version, layout, needed, frozenset(rule.debtors), {rule.me}, len(record.ciphertext))

    def _hopeful(self, pending: Pending, judged: dict[tuple[Rule, int], bool]) -> Pending | NotKept:
        """NotKept if it is known before that it would not be settled. `judged`: by which rules others of the same write could be."""
        rule = self._judging.rule_at(pending.layout, pending.spot)
        assert rule is not None
        asked = rule, pending.needed
        if asked not in judged:
            judged[asked] = self._judging.could_settle(*asked)
        if judged[asked]:
            return pending
        missing = [target.node for target in rule.targets if not self._judging.is_alive(target.node)]
        self._say("too few", f"writes are refused, since too few of who holds copies are there; {_names(missing)}")
        # Not our own id: nothing was stored, but this may pass, unlike a want of nodes that may hold copies at all.
        return NotKept(RejectReason.TOO_FEW_COPIES, missing[0] if missing else NodeId(0))

    # ------------------------------------------------------------------------------------------- once it is stored

    def _stored(self, index: int, put: Put, pending: Pending, result: PutResult) -> list[_Wait]:
        """The store has judged it: send it, or find out what its answer has to wait for."""
        where = result.location or put.at
        if where is not None:
            pending.spot = Spot(pending.spot.place._replace(location=where), pending.spot.object)
        if result.outcome is Outcome.STORED and result.has_changed:
            pending.item = item_of(pending.spot, put.record)
            pending.is_stored = True
            self._judging.send(pending)
            return [_Wait(index, [pending])]
        self._unsettled.drop(pending)
        match result.outcome:
            case Outcome.STORED:
                # The same again: what was said of it the first time nobody knows here.
                return [_Wait(index, self._same(pending))]
            case Outcome.STALE | Outcome.EXISTS:
                return [_Wait(index, self._unsettled.of(name_of(pending.spot)), about=pending.spot)]
            case _:
                return []

    def _same(self, pending: Pending) -> list[Pending]:
        return [other for other in self._unsettled.of(name_of(pending.spot)) if other.version == pending.version]

    async def _repeated(self, repeated: Sequence[tuple[int, Pending]]) -> list[_Wait]:
        """What is here already, and not pending, may be unsettled all the same: since before the start, or in doubt. Who has it is known."""
        waits: list[_Wait] = []
        owed = await self._parts.store.debtors_of([pending.spot for _, pending in repeated])
        for (index, pending), debtors in zip(repeated, owed, strict=True):
            rule = self._judging.rule_at(pending.layout, pending.spot)
            again = replace(pending, debtors=frozenset(debtors), have=set(pending.have), is_stored=True, is_settled=False, settled=None)
            # Others may write the same again, or read it, at this moment. What is not stored may be dropped, and settles nothing by that.
            same = [other for other in self._same(pending) if other.is_stored]
            if same:
                waits.append(_Wait(index, same))
            elif rule is None or not self._judging.is_settled(again, rule):
                # Whatever else is pending there was given to the store since.
                self._unsettled.add(again, is_oldest=True)
                self._judging.send(again)
                waits.append(_Wait(index, [again]))
        return waits

    async def _wait(self, waits: Sequence[_Wait], until: float, outcomes: dict[int, PutResult | NotKept]) -> None:
        told_until = min(until, trio.current_time() + TOLD_S_MAX)
        for wait in waits:
            late = await first_unsettled(wait.pendings, told_until if wait.about else until)
            if late is not None and not wait.about:
                outcomes[wait.which] = self._given_up(late)
            elif late is not None or not await self._may_be_told(wait, told_until):
                outcomes[wait.which] = NotKept(RejectReason.NOT_READY, NodeId(0))
        # All at once, at the end: what was settled first may have gone to another owner while the others were waited for.
        for wait in waits:
            if any(not self._parts.keeper.holding.owns(pending.home) for pending in wait.pendings):
                outcomes[wait.which] = NotKept(RejectReason.NOT_READY, NodeId(0))

    async def _may_be_told(self, wait: _Wait, until: float) -> bool:
        """Of what is settled, as far as it is pending."""
        return await self._settled.place(wait.about, until) if wait.about else all(map(self._judging.counts, wait.pendings))

    def _given_up(self, pending: Pending) -> NotKept:
        # Its bytes are read again when somebody takes them. Its client was told that nobody knows; so it is like what a start finds unsettled.
        pending.item, pending.is_write = None, False
        self._judging.send(pending)
        self._parts.events["not settled in time"] += 1
        rule = self._judging.rule_at(pending.layout, pending.spot)
        missing = [] if rule is None else [target.node for target in rule.targets if target not in pending.have]
        self._say("unsettled", f"what was written is not acknowledged, since too few have it after {ANSWER_S_MAX:g} s; {_names(missing)}")
        return NotKept(RejectReason.NOT_READY, missing[0] if missing else NodeId(0))

    def _say(self, kind: str, text: str) -> None:
        self._quiet.say(self._parts.world.clock.now(), "copies", kind, text)


def _spot(put: Put) -> Spot:
    """Where it belongs; of an object the store says where it lies."""
    header = put.record.header
    return Spot(RecordPlace(header.scene, header.space, header.location), object_of(header))


def _names(nodes: Sequence[NodeId]) -> str:
    return "missing: " + (", ".join(map(address_of, nodes)) or "somebody that could be placed")
