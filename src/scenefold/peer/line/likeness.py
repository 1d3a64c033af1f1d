"""Where a receiver has something else of a piece than its giver (specs/20-copies.md, A bound that moves).

What is released has settled. Whatever else lies on the receiver's disk, newer or alone, is of a former life, or came of an owner that is
gone: it may lie nowhere else, and nobody need have been told of it. So it must not be told from the moment of the claim on as if it counted.
The piece stands still between its release and the claim, so the sums of both sides say it, without a walk over it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId, address_of
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.peer.copies.versions import told_sum
from scenefold.peer.line.parts import Parts
from scenefold.store.layout import SpaceAddress
from scenefold.wire import CompareRange, RangeCompared, Span
from scenefold.world import Priority

LOOK_S_MAX = 1.5
"""In all, as nobody owns the piece meanwhile, and the giver asks anew after 5 s. What is not known by then may be unlike."""
AT_ONCE = 8
"""Spaces that the giver is asked for at one time."""

_log = logging.getLogger("scenefold.peer.line")


async def unlike(parts: Parts, giver: NodeId, piece: Arc) -> set[Layout]:
    """The layouts by which something may lie here that the giver has not, or has otherwise. Called before the claim."""
    near = [(scene, space) for scene, space in await parts.store.spaces_in(piece) if not parts.store.has_let_go(scene)]
    any_layout = _layouts_of_all(parts) if any(_layout_of(parts, *space) is None for space in near) else set[Layout]()
    open_ones: dict[SpaceAddress, set[Layout]] = {}
    for space in near:
        found = _layout_of(parts, *space)
        # One that is unknown here may be any of them.
        if wanted := any_layout if found is None else found:
            open_ones[space] = wanted
    left = iter(list(open_ones))
    with trio.move_on_after(LOOK_S_MAX):
        async with trio.open_nursery() as nursery:
            for _ in range(min(AT_ONCE, len(open_ones))):
                nursery.start_soon(_compare, parts, giver, piece, left, open_ones, nursery.cancel_scope)
    return set[Layout]().union(*open_ones.values())


def _layout_of(parts: Parts, scene: SceneId, space: SpaceId) -> set[Layout] | None:
    """That of the space, none if it has one copy, and had no more before; None if it is unknown here."""
    known = parts.scenes.here(scene)
    layout = None if known is None else known.layouts.get(space)
    if known is None or layout is None:
        return None
    return {layout} if layout or space in known.turns else set()


def _layouts_of_all(parts: Parts) -> set[Layout]:
    return {layout for known in parts.scenes.everyone() for space, layout in known.layouts.items() if layout or space in known.turns}


async def _compare(
    parts: Parts,
    giver: NodeId,
    piece: Arc,
    left: Iterator[SpaceAddress],
    open_ones: dict[SpaceAddress, set[Layout]],
    scope: trio.CancelScope,
) -> None:
    """Take those out of `open_ones` in which there lies here just what lies there. Who is away is not asked any more."""
    for scene, space in left:
        try:
            (own,) = await parts.store.sums(scene, space, [piece])
            if await _sum_at(parts, giver, scene, space, piece) == (own.records, told_sum(own)):
                del open_ones[scene, space]
        except Unreachable:
            scope.cancel()
        except (Refused, PeerFault) as problem:
            _log.debug("%s does not say what it has of a piece: %s", address_of(giver), problem)


async def _sum_at(parts: Parts, giver: NodeId, scene: SceneId, space: SpaceId, piece: Arc) -> tuple[int, bytes]:
    request = CompareRange(scene, space, (Span(piece.first, piece.last),), 0)
    reply = await parts.peers.ask(giver, Priority.HIGH, request, RangeCompared, LOOK_S_MAX)
    if len(reply.sums) != 1:
        raise PeerFault(f"sums of {len(reply.sums)} arcs, where one was asked for", where=address_of(giver))
    return reply.sums[0].count, reply.sums[0].sum
