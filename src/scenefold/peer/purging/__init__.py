"""Deleted records are dropped once no node has anything older (specs/22-purge.md)."""

from __future__ import annotations

from scenefold.peer.purging.arriving import Arriving
from scenefold.peer.purging.purging import Purging

__all__ = ["Arriving", "Purging"]
