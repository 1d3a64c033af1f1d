"""A whole node in one call: world, store, links, services, extensions; all end when the call is cancelled."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import trio

from scenefold.peer import Extension, NodeContext, NodeSettings, PeerServices
from scenefold.store import LmdbDisk, open_store
from scenefold.world import background_tasks, open_links, real_world
from scenefold.world.profile import ClusterProfile

_log = logging.getLogger("scenefold.node")


async def run_node(
    settings: NodeSettings,
    *,
    extensions: Sequence[Extension] | None = None,
    task_status: trio.TaskStatus[NodeContext] = trio.TASK_STATUS_IGNORED,
) -> None:
    """Run the node until cancelled; started, with its context, once it listens on all ports.

    `extensions` None: those that are installed. LocalFault: no profile, no such member, data folder of another node or
    in use, port taken. Unreachable: no seed answered in time.
    """
    profile = ClusterProfile.load(settings.profile_folder)
    me = profile.member(settings.address)
    world = real_world(
        profile.node_identity(me.address),
        profile.authority_certificate(),
        ports=profile.ports,
        disk=LmdbDisk(),
        lanes={"render": settings.render_threads},
    )
    async with (
        open_store(world, settings.data_folder, me.node_id) as store,
        open_links(world) as links,
        background_tasks() as nursery,
    ):
        services = PeerServices(settings, profile, world, store, links)
        for extension in default_extensions() if extensions is None else extensions:
            await nursery.start(extension.run, services.context)
        await nursery.start(services.run)
        _log.info(
            "node %s of cluster %s is ready: ports %d and %d, boot %d, data in %s",
            me.address,
            profile.name,
            profile.ports.low,
            profile.ports.high,
            store.identity.boot,
            settings.data_folder,
        )
        task_status.started(services.context)
        await trio.sleep_forever()


def default_extensions() -> list[Extension]:
    """What a node does beyond storing: it renders."""
    from scenefold.node.rendering import RenderExtension

    return [RenderExtension()]
