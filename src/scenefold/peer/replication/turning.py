"""What binds a space that has turned: those who may still be read by a layout that it had before (specs/23-turns.md, Writes)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.peer.copies.copies import Copies
from scenefold.peer.line.parts import Parts
from scenefold.wire import Configuration, Member
from scenefold.world import first_of


class Turning:
    """By the newest headers that are here. Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts

    def binding(self, scene: SceneId, space: SpaceId, arc: Arc) -> list[Configuration]:
        """Those by which somebody in the arc may be answered for a space without what is written by its present layout."""
        return [configuration for _, configuration in self._binding(scene, space, arc)]

    def is_free(self, scene: SceneId, space: SpaceId, arc: Arc, have: Collection[Member]) -> bool:
        """Whether what these nodes have there may be told, for all that binds it (rule 3)."""
        return all(len(set(have) & set(found.members)) >= found.needed for found in self.binding(scene, space, arc))

    def bound(self) -> list[tuple[Layout, Arc]]:
        """All parts of the arc that are bound for a space, with its present layout."""
        whole = self._parts.keeper.holding.arc
        return [] if whole is None else [(layout, part) for layout, part in self._bound(whole)]

    def is_bound(self, layout: Layout, arc: Arc) -> bool:
        """Whether any space that turned to this layout is bound in a part of the arc."""
        return any(found == layout for found, _ in self._bound(arc))

    async def freed(self, scene: SceneId, space: SpaceId, arc: Arc) -> None:
        """Return once nothing binds it."""
        while self.binding(scene, space, arc):
            await self.changed_after(self._parts.keeper.copies, self._parts.knowing.news)

    async def changed_after(self, copies: Copies, news: int) -> None:
        """Return once that is no longer what is known about copies, or who knows of turns."""
        await first_of(partial(self._parts.keeper.copies_changed_after, copies), partial(self._parts.knowing.changed_after, news))

    def _bound(self, arc: Arc) -> Iterator[tuple[Layout, Arc]]:
        for known in self._parts.scenes.everyone():
            for space in known.turns:
                for part, _ in self._binding(known.public.scene, space, arc):
                    yield known.layouts.get(space, ()), part

    def _binding(self, scene: SceneId, space: SpaceId, arc: Arc) -> Iterator[tuple[Arc, Configuration]]:
        known = self._parts.scenes.here(scene)
        turn = None if known is None else known.turns.get(space)
        if turn is None:
            return
        configurations, knowing = self._parts.keeper.copies.configurations, self._parts.knowing
        is_over = partial(knowing.knows, scene=scene, position=turn.position)
        for segment in configurations.touching(arc):
            if turn.may_have_had(segment.layout):
                for found in segment.configurations:
                    if not segment.is_closed(found, configurations.me, is_over):
                        yield segment.arc, found
