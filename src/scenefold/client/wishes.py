"""What a writer wants to lie somewhere, and what became of it."""

from __future__ import annotations

from typing import NamedTuple

from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import Location
from scenefold.client.verifying import Key
from scenefold.crypto import wanted_place


class Wish(NamedTuple):
    """A payload and where it shall lie. `expect`: None, ABSENT, or the digest of what it replaces."""

    space: SpaceId
    location: Location
    payload: bytes
    expect: bytes | None = None
    content_position: int | None = None
    """The log position that coordinates in the payload belong to; None: that of the log as the scene knows it."""
    object: bytes = b""
    """Of a node-managed record: its id. `location` is then `signed_place` of it: the node chooses where it lies."""
    above: int = 0
    """The number of the version that lies there, where an earlier try was none too high for it."""

    def __repr__(self) -> str:
        """Without what is to be sealed: errors are logged."""
        return f"Wish(space={self.space}, location={self.location.hex()}, {len(self.payload)} bytes)"

    @property
    def key(self) -> Key:
        return (self.space, self.location, self.object) if self.object else (self.space, self.location)

    @property
    def route(self) -> Location:
        """The place whose owner is asked."""
        return wanted_place(self.object) if self.object else self.location


class Placed(NamedTuple):
    """What became of a wish: `reason` 0 is durable; `digest` is that of our record, `node` the one that answered."""

    reason: int
    digest: bytes
    node: NodeId
    location: Location
    """Where it lies: in a node-managed space the node's choice, else as wished."""
