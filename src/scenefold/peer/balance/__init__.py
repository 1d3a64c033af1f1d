"""Who gives a piece of the line to whom, and when: balance, joining, leaving (thesis Algorithm 5; specs/13-balance.md)."""

from scenefold.peer.balance.balancer import Balancer
from scenefold.peer.balance.draining import Draining, NodeDrained
from scenefold.peer.balance.joining import Joining
from scenefold.peer.balance.load import OwnLoad, Recovering
from scenefold.peer.balance.sharing import Sharing

__all__ = ["Balancer", "Draining", "Joining", "NodeDrained", "OwnLoad", "Recovering", "Sharing"]
