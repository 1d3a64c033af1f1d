"""What a service of a node is given: everything that the node consists of, by name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import trio

from scenefold.base.ids import NodeId
from scenefold.peer.balance import Balancer, Draining
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.lease import OwnerLease
from scenefold.peer.enrolment.discovery import Discovery
from scenefold.peer.enrolment.enrolment import Enrolment
from scenefold.peer.handlers import Handlers
from scenefold.peer.line import Line
from scenefold.peer.logs import Logs
from scenefold.peer.membership.gossip import Gossip
from scenefold.peer.membership.probing import Probing
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.purging.suspects import Suspects
from scenefold.peer.records.data import DataService
from scenefold.peer.records.range_datagrams import RangeDatagrams
from scenefold.peer.replication import Replication
from scenefold.peer.routing import Routing
from scenefold.peer.scene_log.participation import Participation
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.peer.scrub import Scrub
from scenefold.peer.settings import NodeSettings
from scenefold.peer.upkeep import OwnUpkeep
from scenefold.store import Store
from scenefold.world import Links, World
from scenefold.world.facts import ClusterFacts


@dataclass(frozen=True, slots=True)
class NodeContext:
    """One running node, as its services and extensions see it."""

    settings: NodeSettings
    facts: ClusterFacts
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
    cluster_log: ClusterLog
    """Who is a member, and in which order members stand on the line."""
    lease: OwnerLease
    line: Line
    """What this node owns, and how pieces of it change hands."""
    scenes: Scenes
    logs: Logs
    """Those that this node decides with others, or learns, by genesis."""
    participation: Participation
    """Which of them are those of scenes."""
    replication: Replication
    """Who holds copies of what it owns, and what it holds for others."""
    data: DataService
    enrolment: Enrolment
    balancer: Balancer
    draining: Draining
    scrub: Scrub
    """Reads all records again and again; whoever repairs listens to it."""
    upkeep: OwnUpkeep
    """What of that an administrator has paused, and how fast the rest may go."""
    suspects: Suspects
    """What this node has brought along from a former life, and nobody may bring home by himself."""
    gossip: Gossip
    range_datagrams: RangeDatagrams
    discovery: Discovery
    probing: Probing
    joined: trio.Event = field(default_factory=trio.Event)
    """Set once this node is a member with a lease, and knows the other members and the scenes as far as they answer."""


class Extension(Protocol):
    """A service from a floor above. It runs in the node's nursery, and ends with it."""

    async def run(self, context: NodeContext, *, task_status: trio.TaskStatus[None]) -> None:
        """Add handlers, call `task_status.started()`, then run until cancelled."""
        ...
