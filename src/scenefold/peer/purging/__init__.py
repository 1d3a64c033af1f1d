"""Deleted records are dropped once no node has anything older (specs/22-purge.md), and scenes that were ended once all nodes know it."""

from __future__ import annotations

from scenefold.peer.purging.arriving import Arriving
from scenefold.peer.purging.letting_go import LettingGo
from scenefold.peer.purging.purging import Purging

__all__ = ["Arriving", "LettingGo", "Purging"]
