"""The services of a node: roster, gossip, routing, records, scene headers (specs/11-peers.md)."""

from scenefold.peer.balance import NodeDrained
from scenefold.peer.context import Extension, NodeContext
from scenefold.peer.enrolment.enrolment import IdentityRenewed
from scenefold.peer.handlers import Handler, Handlers, Senders, node_of
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import Load, OwnStatus
from scenefold.peer.routing import Routing
from scenefold.peer.services import PeerServices
from scenefold.peer.settings import NodeSettings

__all__ = [
    "Extension",
    "Handler",
    "Handlers",
    "IdentityRenewed",
    "Load",
    "NodeContext",
    "NodeDrained",
    "NodeSettings",
    "OwnStatus",
    "PeerServices",
    "Roster",
    "Routing",
    "Senders",
    "node_of",
]
