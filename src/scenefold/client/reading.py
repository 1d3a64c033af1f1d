"""Scenes for a process that was handed keys instead of a profile: a node that renders for somebody.

It reads with the client's own classes over the links that it has anyway, and cannot write.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId
from scenefold.client.access import SceneAccess
from scenefold.client.births import header_key_of, verify_header, writers_of
from scenefold.client.calls import Calls
from scenefold.client.scene import Scene
from scenefold.client.scene_log import LogAccess, LogKeys
from scenefold.client.sealing import SceneIdentity
from scenefold.wire import SceneLogPublic
from scenefold.world import Links, World


def open_scene_with_keys(
    world: World,
    links: Links,
    members: Sequence[tuple[NodeId, str]],
    header: SceneLogPublic,
    symmetric_key: bytes,
    *,
    key_epoch: int = 0,
    name: str = "",
) -> Scene:
    """A scene to read. `members`: ids and addresses of the nodes, in the order of the line.

    `header`: the scene's verified public header, as a node's store has it; a first header is verified again.
    """
    if header.position <= 1:
        verify_header(header, header.scene, header.genesis)
    identity = SceneIdentity(
        scene=header.scene,
        genesis=header.genesis,
        position=header.position,
        writers=writers_of(header),
        symmetric_key=symmetric_key,
        key_epoch=key_epoch,
    ).with_header(header)
    calls = Calls(world, links, [address for _, address in members], [node_id for node_id, _ in members])
    name = name or f"{header.scene:08x}"
    keys = LogKeys(header.scene, header.genesis, symmetric_key, key_epoch, header_key_of(header))
    return Scene(SceneAccess(calls, name, identity, writer=None, log=LogAccess(calls, name, keys)))
