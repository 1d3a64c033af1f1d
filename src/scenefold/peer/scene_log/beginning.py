"""How a node that starts comes to know scenes: from its disk, and from the first who list theirs (specs/16-scene-log.md, Headers spread)."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Protocol

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.consensus.packets import scene_of
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.headers import checked_header
from scenefold.peer.scene_log.scene_asking import tell_all
from scenefold.scene.log.values import deciding
from scenefold.wire import MalformedPacket, SceneLogPublic

_log = logging.getLogger("scenefold.peer.scene_log.scenes")


class Keeps(Protocol):
    """What is asked of the store."""

    async def headers(self) -> dict[SceneId, bytes]: ...
    async def get_scene_log(self, scene: SceneId) -> bytes | None: ...
    async def logs_kept(self) -> frozenset[bytes]: ...


async def load_headers(store: Keeps) -> dict[SceneId, KnownScene]:
    """What this node kept from before.

    A header that does not verify any more is left out: others have it, and it is pulled when the scene is met. But who
    decides alone must not forget how far it is: DamagedData. A participant's rows of the log say what it has voted for.
    """
    voted = {scene_of(genesis) for genesis in await store.logs_kept()}
    known: dict[SceneId, KnownScene] = {}
    for scene, header in (await store.headers()).items():
        try:
            known[scene] = checked_header(SceneLogPublic.decode(header), None)
        except (MalformedPacket, Refused) as problem:
            where = f"scene {scene:08x}: {problem}"
            if scene not in voted and await store.get_scene_log(scene) is not None:
                remedy = "restore the data folder from a backup, or start with an empty one; the scene's spaces stand still then"
                raise DamagedData("the header of a scene whose log is kept here is damaged", where=where, remedy=remedy) from problem
            _log.error("a damaged scene header is dropped and asked for again: %s", where)
    return known


async def catch_up(
    peers: Peers,
    me: NodeId,
    take_list: Callable[[NodeId], Awaitable[Sequence[SceneLogPublic] | None]],
    known: Mapping[SceneId, KnownScene],
) -> None:
    """Take the list of scenes of the first other member that answers; tell what this node decided and that list lacks. `known`: a live view."""
    for member in peers.others():
        listed = await take_list(member)
        if listed is None:
            continue
        others = peers.others()
        deciders = {next((node for node in others if node in deciding(public)), member) for public in listed}
        for decider in sorted(deciders - {member}):
            # What was shown was decided, and may be old: who decides knows.
            await take_list(decider)
        told = {public.scene: public.position for public in listed}
        for scene in sorted(scene for scene, one in known.items() if me in deciding(one.public)):
            # It may have died between deciding and telling.
            public = known[scene].public
            if told.get(scene, 0) < public.position:
                await tell_all(peers, public)
        return
