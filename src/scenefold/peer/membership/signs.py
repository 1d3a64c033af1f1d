"""Signs that somebody means harm, or that two machines have the keys of one: what a node has met, and when last (specs/11-peers.md, Report). Pure.

A line in one node's log is read by nobody; what stands in its report, `cluster status` warns of.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Sign(StrEnum):
    """What was met. Each is dropped, and changes nothing."""

    OWN_KEY = "own key"
    """A status of this life of this node, signed with its key, that it did not make."""
    CONTESTED = "contested"
    """A claim on this node's places that lasts longer than old news do."""
    FORGED = "forged"
    """A status of a node whose key is known, and that it did not sign."""


@dataclass(slots=True)
class Seen:
    """`source`: address of the node that sent the last one, which may have heard it from another."""

    count: int = 0
    at: float = 0.0
    source: str = ""


class Signs:
    """What one life of a node has met."""

    def __init__(self) -> None:
        self._seen: dict[Sign, Seen] = {}

    def note(self, sign: Sign, source: str, now: float) -> None:
        seen = self._seen.setdefault(sign, Seen())
        seen.count, seen.at, seen.source = seen.count + 1, now, source

    def documents(self, now: float) -> list[dict[str, Any]]:
        """What the report says of them, those that were met only."""
        found = sorted(self._seen.items())
        return [{"kind": str(sign), "count": seen.count, "ago_s": now - seen.at, "source": seen.source} for sign, seen in found]
