"""Releases: "I use no lease of a position below this one, and shall use none" (specs/26-modes.md, The switch)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from scenefold.wire import Member


def _nobody() -> Mapping[Member, int]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Releases:
    """`own`: the highest position that this node released; durable. `heard`: likewise of others, as they said."""

    own: int = 0
    heard: Mapping[Member, int] = field(default_factory=_nobody)

    def release(self, position: int) -> Releases:
        """To be made durable before it is signed. What was released once stays so."""
        return replace(self, own=max(self.own, position))

    def hear(self, member: Member, position: int) -> Releases:
        """A true one."""
        if position <= self.heard.get(member, 0):
            return self
        return replace(self, heard=MappingProxyType({**self.heard, member: position}))

    def allow(self, position: int) -> bool:
        """Whether a lease of this position may be asked for."""
        return position >= self.own

    def cover(self, member: Member, position: int) -> bool:
        """Whether somebody uses no lease below this position."""
        return self.heard.get(member, 0) >= position
