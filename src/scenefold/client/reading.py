"""Scenes for a process that was handed keys instead of a profile: a node that renders for somebody.

It reads with the client's own classes over the links that it has anyway, and cannot write.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId
from scenefold.client.access import SceneAccess
from scenefold.client.births import verified_header_key
from scenefold.client.calls import Calls
from scenefold.client.scene import Scene
from scenefold.client.scene_log import LogAccess
from scenefold.client.scene_memory import Met, SceneMemory
from scenefold.client.sealing import SceneIdentity
from scenefold.client.verifying import writers_of
from scenefold.scene.log import EpochKeys, SceneKeys
from scenefold.wire import Role, SceneLogPublic
from scenefold.world import Links, World


def open_scene_with_keys(
    world: World,
    links: Links,
    members: Sequence[tuple[NodeId, str]],
    header: SceneLogPublic,
    epochs: EpochKeys,
    *,
    name: str = "",
) -> Scene:
    """A scene to read. `members`: ids and addresses of the nodes, in the order of the line.

    `header`: the scene's public header, as a node's store has it; DamagedData if it does not prove itself.
    """
    header_key = verified_header_key(header)
    identity = SceneIdentity(
        scene=header.scene,
        genesis=header.genesis,
        position=header.position,
        writers=writers_of(header),
        keys=epochs,
    ).with_header(header)
    calls = Calls(world, links, [address for _, address in members], [node_id for node_id, _ in members])
    name = name or f"{header.scene:08x}"
    keys = SceneKeys(name, header.genesis, epochs, header_key, Role.READER)
    return Scene(SceneAccess(calls, name, identity, writer=None, log=LogAccess(calls, keys, memory=SceneMemory(Met.by(header)))))
