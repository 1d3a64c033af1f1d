"""An owner compares what its holders have with what it has, and both get what they lack (specs/20-copies.md, Changing, Repair).

Each holder is worked on by a task of its own, so that one that is slow or away holds up nobody; in all they take no more bytes a second than
the node may move. Whoever is not complete comes first, and of his segments those of which there are the fewest complete copies.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId, address_of
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.entries import Entry
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.comparing_jobs import Job, jobs, waiting
from scenefold.peer.replication.comparing_progress import Left, Progress
from scenefold.peer.replication.comparing_space import HolderFull, Merge, SpaceComparison
from scenefold.wire import Member

LOOK_S = 1.0
"""Between two looks at who was heard again, or is to be looked at once more."""
AGAIN_S = 3600.0
"""Whoever counts as complete is compared again."""

_log = logging.getLogger("scenefold.peer.replication")


class Comparing:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, roster: Roster, merge: Merge, on_full: Callable[[Member], None]) -> None:
        """`on_full`: told of a holder that has no room."""
        self._parts = parts
        self._on_full = on_full
        self._roster = roster
        self._merge = merge
        self._progress = Progress(parts.world.clock)
        self._working: set[Member] = set()
        self._checked: dict[tuple[Member, Layout, Arc], float] = {}
        self._was_alive: set[NodeId] = set()
        self._layouts: dict[tuple[SceneId, SpaceId], Layout] = {}

    @property
    def left(self) -> Left:
        """What is still to be brought to holders, as far as it is known."""
        self._progress.segments = waiting(self._parts.keeper.copies.configurations)
        return self._progress.left()

    def check_all(self) -> None:
        """Have everybody compared again, as after a start."""
        self._checked = {}

    async def run(self) -> None:
        """Compare until cancelled."""
        async with trio.open_nursery() as nursery:
            while True:
                seen = self._parts.keeper.copies
                if seen.configurations.segments:
                    self._look()
                    for holder in self._jobs():
                        if holder not in self._working and self._is_there(holder):
                            self._working.add(holder)
                            nursery.start_soon(self._work, holder)
                with trio.move_on_after(LOOK_S):
                    await self._parts.keeper.copies_changed_after(seen)

    # -------------------------------------------------------------------------------------------- what is to be done

    def _is_there(self, holder: Member) -> bool:
        return self._roster.is_believed_alive(holder.node) and not self._parts.keeper.is_removed(holder)

    def _look(self) -> None:
        """Who was away is compared again, and so are all where a space has come to other holders, or is known only now."""
        holders = {member for member, _, _ in self._checked}
        alive = {member.node for member in holders if self._roster.is_believed_alive(member.node)}
        back = alive - self._was_alive
        self._was_alive |= alive
        self._was_alive -= {member.node for member in holders} - alive
        before = self._note_layouts()
        moved = {layout for space, layout in self._layouts.items() if before.get(space) != layout}
        if back or moved:
            self._checked = {key: at for key, at in self._checked.items() if key[0].node not in back and key[1] not in moved}

    def _note_layouts(self) -> dict[tuple[SceneId, SpaceId], Layout]:
        """What spaces there are; answers what there were before."""
        has_let_go = self._parts.store.has_let_go
        before, scenes = self._layouts, [scene for scene in self._parts.scenes.everyone() if not has_let_go(scene.public.scene)]
        self._layouts = {(scene.public.scene, space): layout for scene in scenes for space, layout in scene.layouts.items()}
        return before

    def _is_checked(self, holder: Member, layout: Layout, arc: Arc) -> bool:
        at = self._checked.get((holder, layout, arc))
        return at is not None and self._parts.world.clock.now() - at < AGAIN_S

    def _jobs(self, put_off: Collection[Entry] = ()) -> dict[Member, Job]:
        return jobs(self._parts.keeper.copies.configurations, self._is_checked, put_off, is_resting=self._parts.resting.repair)

    async def _work(self, holder: Member) -> None:
        """Until nothing is left to be done for this holder, or it is away."""
        pauses = Pauses(self._parts.world)
        put_off: set[Entry] = set()
        try:
            while self._is_there(holder):
                job = self._jobs(put_off).get(holder)
                if job is None:
                    return
                try:
                    await self._do(job)
                    put_off.clear()
                    pauses.reset()
                except (Refused, Unreachable, PeerFault) as problem:
                    # Whatever may hold this up for long does not hold up the rest: it is tried again behind the next one.
                    if put_off.issuperset(job.entries):
                        put_off.clear()
                    put_off.update(job.entries)
                    if isinstance(problem, HolderFull):
                        self._on_full(holder)
                    self._parts.events["comparisons broken off"] += 1
                    _log.debug("%s is compared again later: %s", address_of(holder.node), problem)
                    await pauses.wait()
        finally:
            self._working.discard(holder)

    # -------------------------------------------------------------------------------------------------------- doing

    async def _do(self, job: Job) -> None:
        parts, arcs = self._parts, [entry.arc for entry in job.entries]
        # What was written by those who did not know the holder yet is there when this returns.
        await parts.keeper.flush()
        await self._learn_scenes()
        begin = parts.world.clock.now()
        self._look()
        has_new_husks, is_complete = False, True
        for scene, space in await self._spaces(job):
            comparison = SpaceComparison(parts, self._merge, self._progress, job.holder, scene, space, arcs)
            comparison.can_rest = job.can_rest
            # What keeps one space from being complete, as a record that nobody can be asked for just now, is no reason not to bring the others.
            is_complete &= await comparison.run()
            has_new_husks |= comparison.has_new_husks
        if not is_complete:
            raise Refused(RejectReason.BUSY, "some records have changed meanwhile")
        if not parts.cluster_log.registry.is_current(job.holder):
            raise Refused(RejectReason.WRONG_INCARNATION, "another incarnation may have answered")
        if not job.is_routine:
            await parts.keeper.change_copies(lambda copies, _holding: _compared(copies, job))
        parts.events["compared"] += len(arcs)
        others = {key: at for key, at in self._checked.items() if not (has_new_husks and key[1] == job.layout)}
        self._checked = {key: at for key, at in others.items() if begin - at < AGAIN_S}
        self._checked.update(((job.holder, job.layout, arc), begin) for arc in arcs)

    async def _learn_scenes(self) -> None:
        """Know all scenes of which records lie here, if anybody does: those of an unknown one the holder would lack, and count as complete."""
        scenes = self._parts.scenes
        for scene in sorted({scene for scene, _ in await self._parts.store.spaces()}):
            if scenes.here(scene) is None:
                with suppress(Refused):
                    await scenes.known(scene)

    async def _spaces(self, job: Job) -> Sequence[tuple[SceneId, SpaceId]]:
        """Those of the layout that have records here; where nothing waits for it, also those of which only the holder may have any."""
        known = sorted(space for space, layout in self._layouts.items() if layout == job.layout)
        if job.is_routine:
            return known
        here = set(await self._parts.store.spaces())
        return [space for space in known if space in here]


def _compared(copies: Copies, job: Job) -> Copies:
    configurations = copies.configurations
    for entry in job.entries:
        configurations = configurations.compare(job.holder, entry)
    return copies if configurations is copies.configurations else replace(copies, configurations=configurations)
