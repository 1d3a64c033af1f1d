"""What the roster needs to know of who is a member: a small part of the registry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from scenefold.base.ids import NodeId


class RegisteredNode(Protocol):
    """A member as the cluster's log has it."""

    @property
    def incarnation(self) -> bytes: ...


class MemberList(Protocol):
    """Nodes in line order; `current` is None for a founder that never came."""

    @property
    def position(self) -> int: ...

    @property
    def order(self) -> Sequence[NodeId]: ...

    def current(self, node: NodeId, /) -> RegisteredNode | None: ...
