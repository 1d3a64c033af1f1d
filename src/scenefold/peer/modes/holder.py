"""A node's own lease of a scene (specs/26-modes.md, Leases): in memory only, so who starts holds none."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from scenefold.base.ids import NodeId
from scenefold.peer.timing import T_LEASE_S


@dataclass(frozen=True, slots=True)
class Asking:
    """The newest question, and who has granted it. `deciders`: who decides the position after the one that it names."""

    nonce: int
    position: int
    at: float
    deciders: frozenset[NodeId]
    granted: frozenset[NodeId] = frozenset()

    @property
    def is_granted(self) -> bool:
        return len(self.granted & self.deciders) >= len(self.deciders) // 2 + 1


@dataclass(frozen=True, slots=True)
class Held:
    """A lease of this position, until then."""

    position: int
    until: float


@dataclass(frozen=True, slots=True)
class Holder:
    asking: Asking | None = None
    held: Held | None = None

    def ask(self, position: int, nonce: int, deciders: Collection[NodeId], now: float) -> Holder:
        """Ask anew; answers to what was asked before count no more."""
        return replace(self, asking=Asking(nonce, position, now, frozenset(deciders)))

    def granted(self, nonce: int, by: NodeId) -> Holder:
        """A GRANT came. The lease runs from the moment of asking."""
        asking = self.asking
        if asking is None or asking.nonce != nonce:
            return self
        asking = replace(asking, granted=asking.granted | {by})
        held = Held(asking.position, asking.at + T_LEASE_S) if asking.is_granted else self.held
        return Holder(asking, held)

    def dropped(self) -> Holder:
        """Nothing is held, and no answer to what was asked before makes it so."""
        return Holder()

    def lease(self, now: float) -> Held | None:
        """What is held at this moment."""
        return self.held if self.held is not None and now < self.held.until else None
