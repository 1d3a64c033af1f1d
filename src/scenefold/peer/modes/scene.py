"""What is decided of a scene, as far as leases go by it (specs/26-modes.md, Who)."""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.base.ids import NodeId
from scenefold.wire import Member, SceneLogPublic, SceneMode


@dataclass(frozen=True, slots=True)
class DecidedScene:
    """As of the newest position that a node knows to be decided; participants and observers are those of the next one."""

    position: int
    mode: SceneMode
    participants: frozenset[Member]
    observers: frozenset[Member] = frozenset()

    @classmethod
    def of(cls, public: SceneLogPublic) -> DecidedScene:
        return cls(
            public.position,
            public.mode,
            frozenset(entry.member for entry in public.participants),
            frozenset(entry.member for entry in public.observers),
        )

    @property
    def everyone(self) -> frozenset[Member]:
        """Who may hold a lease."""
        return self.participants | self.observers

    @property
    def deciders(self) -> frozenset[NodeId]:
        return frozenset(member.node for member in self.participants)

    def is_switched_by(self, after: DecidedScene) -> bool:
        """Whether what leads from this one to the next is a SetMode."""
        return after.mode is not self.mode

    def ends_leases_with(self, after: DecidedScene) -> bool:
        """Whether what leads from this one to the next is a SetMode, or changes who takes part: then a lease of this one may be one too many."""
        return self.is_switched_by(after) or (self.participants, self.observers) != (after.participants, after.observers)
