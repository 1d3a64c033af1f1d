"""A cluster as its user sees it: who is there, and which scenes it holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.limits import CLIENT_STATUS_S
from scenefold.base.location import LINE_LENGTH
from scenefold.client.calls import Calls, no_answer
from scenefold.client.scenes import Scenes
from scenefold.client.table import Owner
from scenefold.client.together import together
from scenefold.crypto import SigningKey
from scenefold.wire import RequestTable, RespondTable, Status
from scenefold.world import Links, Priority, World
from scenefold.world.profile import ClusterProfile

Result = TypeVar("Result")

_FRACTION_ONE = 2**32
_BLOCK_BYTES = 4096


@dataclass(frozen=True, slots=True)
class NodeState:
    """One member. `status` is what it says of itself; None if it does not answer."""

    address: str
    right_bound: bytes | None
    """None: it owns nothing."""
    share: float
    """Part of the line that it owns."""
    status: Status | None

    @property
    def alive(self) -> bool:
        return self.status is not None

    @property
    def disk_fraction(self) -> float:
        return 0.0 if self.status is None else self.status.offline_fraction / _FRACTION_ONE

    @property
    def disk_bytes_used(self) -> int:
        return 0 if self.status is None else round(self.disk_fraction * self.status.offline_blocks * _BLOCK_BYTES)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "address": self.address,
            "alive": self.alive,
            "right_bound": None if self.right_bound is None else self.right_bound.hex(),
            "share": self.share,
            "disk_bytes_used": self.disk_bytes_used if self.alive else None,
            "disk_fraction": round(self.disk_fraction, 4) if self.alive else None,
            "memory_fraction": None if self.status is None else round(self.status.online_fraction / _FRACTION_ONE, 4),
            "boot": None if self.status is None else self.status.boot,
        }


@dataclass(frozen=True, slots=True)
class ClusterStatus:
    """All members in the order of the line."""

    name: str
    nodes: tuple[NodeState, ...]

    @property
    def degraded(self) -> bool:
        """True if a member does not answer."""
        return not all(node.alive for node in self.nodes)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {"name": self.name, "degraded": self.degraded, "nodes": [node.document() for node in self.nodes]}


class Cluster:
    """Made by `connect`. `calls` and `links` are there for rooms above, such as the renderer's client."""

    def __init__(self, profile: ClusterProfile, world: World, links: Links, writer: SigningKey) -> None:
        founders = [member for member in profile.members if member.node_id in profile.founders]
        spares = [(member.node_id, member.address) for member in profile.members if member.node_id not in profile.founders]
        self.profile = profile
        self.name = profile.name
        self.links = links
        self.calls = Calls(world, links, [m.address for m in founders], [m.node_id for m in founders], spares=spares)
        self.scenes = Scenes(self.calls, profile.keyring, writer, profile.voters[0])

    async def nodes(self) -> list[Owner]:
        """All nodes on the line with their right bounds, as one of them knows them; those that own nothing last."""
        await self.calls.refresh()
        return list(self.calls.table.owners)

    async def status(self) -> ClusterStatus:
        """Ask every node on the line itself, at once. Unreachable if none answers."""
        answers: dict[str, Status] = {}
        silent: list[ScenefoldError] = []
        await self.calls.refresh()
        owners = self.calls.table.owners

        async def ask(address: str, node_id: int) -> None:
            try:
                reply = await self.calls.ask(address, RequestTable(), RespondTable, priority=Priority.HIGH, timeout_s=CLIENT_STATUS_S)
            except (Unreachable, Refused) as error:
                silent.append(error)
                return
            own = next((status for status in reply.statuses if status.node == node_id), None)
            if own is not None:
                answers[address] = own

        await together(partial(ask, owner.address, owner.node_id) for owner in owners)
        if not answers:
            raise no_answer([owner.address for owner in owners], silent[-1] if silent else None)
        arcs = {owner.node_id: arc for owner, arc in self.calls.table.arcs()}
        nodes = []
        for owner in owners:
            arc = arcs.get(owner.node_id)
            share, bound = (0.0, None) if arc is None else (arc.length / LINE_LENGTH, arc.last)
            nodes.append(NodeState(owner.address, bound, share, answers.get(owner.address)))
        return ClusterStatus(self.name, tuple(nodes))

    async def in_worker(self, lane: str, function: Callable[..., Result], *arguments: object) -> Result:
        """Run what computes or blocks in a thread of this client's lane."""
        return await self.calls.world.workers.run(lane, function, *arguments)
