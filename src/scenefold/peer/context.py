"""What a service of a node is given: everything that the node consists of, by name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import trio

from scenefold.base.ids import NodeId
from scenefold.peer.data import DataService
from scenefold.peer.handlers import Handlers
from scenefold.peer.peers import Peers
from scenefold.peer.roster import Roster
from scenefold.peer.routing import Routing
from scenefold.peer.scenes import Scenes
from scenefold.peer.settings import NodeSettings
from scenefold.peer.status import OwnStatus
from scenefold.store import Store
from scenefold.world import Links, World
from scenefold.world.profile import ClusterProfile


@dataclass(frozen=True, slots=True)
class NodeContext:
    """One running node, as its services and extensions see it."""

    settings: NodeSettings
    profile: ClusterProfile
    me: NodeId
    address: str
    world: World
    store: Store
    links: Links
    roster: Roster
    routing: Routing
    own: OwnStatus
    """What this node says of itself; extensions `own.update(rays_per_second=...)`."""
    peers: Peers
    handlers: Handlers
    """Extensions add theirs before they report that they have started."""
    scenes: Scenes
    data: DataService
    joined: trio.Event = field(default_factory=trio.Event)
    """Set once every member has been heard and the list of scenes is that of the others."""


class Extension(Protocol):
    """A service from a floor above. It runs in the node's nursery, and ends with it."""

    async def run(self, context: NodeContext, *, task_status: trio.TaskStatus[None]) -> None:
        """Add handlers, call `task_status.started()`, then run until cancelled."""
        ...
