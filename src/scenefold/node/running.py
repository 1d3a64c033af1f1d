"""A whole node in one call: store, links, services, extensions; all end when the call is cancelled.

`run_assembled` is one life of a node in any world, real or simulated; `run_node` takes profile, keys and the real
world from this machine. A life may end because the store has taken a new incarnation (IdentityRenewed, see
peer/enrolment/enrolment.py): then the next one begins at once, with nothing left of what was in memory.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import partial
from typing import Protocol

import trio

from scenefold.base.ids import node_id_of
from scenefold.base.limits import STORE_RESERVE_BYTES
from scenefold.crypto import MemberSecrets, SigningKey
from scenefold.peer import Extension, IdentityRenewed, NodeContext, NodeDrained, NodeSettings, PeerServices
from scenefold.peer.enrolment.papers import NO_PAPERS, Papers
from scenefold.store import LmdbDisk, open_store
from scenefold.world import World, background_tasks, open_links, real_world
from scenefold.world.facts import ClusterFacts
from scenefold.world.own_papers import check_papers, opened_authority
from scenefold.world.profile import ClusterProfile

_log = logging.getLogger("scenefold.node")


class Starting(Protocol):
    """Who waits for a node to listen; Trio's TaskStatus is one."""

    def started(self, value: NodeContext, /) -> None: ...


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
    secrets, log_key = profile.node_secrets(me.address), profile.log_signing_key(me.address)
    identity = profile.node_identity(me.address)
    check_papers(profile, identity, secrets)
    # Found out now, and not on the day that a certificate ends.
    opened_authority(profile, me.address, secrets)
    papers = Papers(
        identity.certificate,
        profile.sealed_authority(me.address) or b"",
        partial(profile.keep_node_certificate, me.address),
        partial(profile.forget_log_key, me.address),
    )
    world = real_world(
        identity,
        profile.authority_certificate(),
        ports=profile.ports,
        disk=LmdbDisk(ahead_bytes_max=STORE_RESERVE_BYTES),
        lanes={"render": settings.render_threads},
    )
    chosen = default_extensions() if extensions is None else extensions
    joined, first = trio.Event(), _FirstStart(task_status)
    while True:
        try:
            await run_assembled(settings, profile.facts(), secrets, log_key, world, chosen, joined=joined, papers=papers, task_status=first)
        except NodeDrained:
            _log.info("node %s has left the cluster: it may be switched off", me.address)
            return
        except IdentityRenewed:
            _log.info("node %s begins its next life", me.address)


async def run_assembled(
    settings: NodeSettings,
    facts: ClusterFacts,
    secrets: MemberSecrets,
    log_signing_key: SigningKey | None,
    world: World,
    extensions: Sequence[Extension] = (),
    *,
    joined: trio.Event | None = None,
    papers: Papers = NO_PAPERS,
    task_status: Starting = trio.TASK_STATUS_IGNORED,
) -> None:
    """One life of a node in this world, until cancelled; started, with its context, once it listens on all ports.

    `log_signing_key`: on the voter, the key of the cluster's log. `joined`: set once the node has joined; of the next
    life too, if it is given again. `papers`: what the node has from the authority. IdentityRenewed: run it again on the same disk. Errors are those of `run_node`.
    """
    async with (
        open_store(world, settings.data_folder, node_id_of(settings.address)) as store,
        open_links(world) as links,
        background_tasks() as nursery,
    ):
        services = PeerServices(
            settings,
            facts,
            secrets,
            log_signing_key,
            world,
            store,
            links,
            joined=trio.Event() if joined is None else joined,
            papers=papers,
        )
        for extension in extensions:
            await nursery.start(extension.run, services.context)
        await nursery.start(services.run)
        _log.info(
            "node %s of cluster %s is ready: ports %d and %d, boot %d, data in %s",
            settings.address,
            facts.name,
            facts.ports.low,
            facts.ports.high,
            store.identity.boot,
            settings.data_folder,
        )
        task_status.started(services.context)
        await trio.sleep_forever()


def default_extensions() -> list[Extension]:
    """What a node does beyond storing: it renders."""
    from scenefold.node.rendering import RenderExtension

    return [RenderExtension()]


class _FirstStart:
    """A task has started once, however many lives the node has."""

    def __init__(self, status: trio.TaskStatus[NodeContext]) -> None:
        self._status = status
        self._is_told = False

    def started(self, value: NodeContext) -> None:
        if not self._is_told:
            self._is_told = True
            self._status.started(value)
