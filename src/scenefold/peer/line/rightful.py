"""Where records lie by right on this node: in arc and handovers, and of each space where this node holds its copies (specs/20-copies.md, Custody)."""

from __future__ import annotations

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.placement import Layout
from scenefold.peer.line.parts import Parts
from scenefold.store import Rightful

NO_COPIES: Layout = ()


async def layout_of(parts: Parts, scene: SceneId, space: SpaceId) -> Layout | None:
    """Where copies of a space belong, as far as this node knows by itself; None if it does not know the space."""
    try:
        known = await parts.scenes.known(scene, ask=False)
    except Refused:
        return None
    return known.layouts.get(space, NO_COPIES if space in known.shadows else None)


async def rightful(parts: Parts) -> Rightful:
    """As of the holding and the custody of this moment."""
    spaces = await parts.store.spaces() if parts.keeper.copies.custody.entries else []
    layouts = {space: await layout_of(parts, *space) for space in spaces}
    custody = parts.keeper.copies.custody
    # Of what layout a space is that is unknown here nobody can say: it may be any, and a copy is not given up by mistake.
    anywhere = [entry.arc for entry in custody.entries]
    held = {space: anywhere if layout is None else custody.arcs(layout) for space, layout in layouts.items()}
    return Rightful(parts.keeper.holding.kept, held)
