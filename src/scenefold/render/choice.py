"""Which nodes may render a scene: trusted by the cluster, or granted the scene, under keys that the authority certified. Pure (specs/19-jobs.md).

What goes in was verified by whoever gives it: the view is the fold of the cluster's signed log, grants are those of the scene's own log,
keys are those of certificates. Each speaks of keys, and a node counts only where all of them mean the same ones.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.crypto import ED25519, SealingPublicKey
from scenefold.scene.log import Granted
from scenefold.world.log_view import LogView, NodeKeys

STRANGE = "neither trusted, nor granted the scene"
UNKNOWN = "no certificate of it is known"
OTHER_KEYS = "it is a member under other keys than those of its certificate"
REVOKED = "its key is revoked"
SILENT = "it does not answer"
OTHER_CLASS = "what it renders would differ in bits from what the others do: its versions, or its processor's maker, are others"
TOO_MANY = f"a job has at most {POOL_NODES_MAX} nodes"


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A member that does not render the scene, and why."""

    node: NodeId
    why: str

    def document(self) -> dict[str, str]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {"address": address_of(self.node), "why": self.why}


@dataclass(frozen=True, slots=True)
class Renderers:
    """`sealing`: what to seal to, of each node that may render, in the order of the line."""

    sealing: Mapping[NodeId, SealingPublicKey]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def nodes(self) -> tuple[NodeId, ...]:
        return tuple(self.sealing)

    def without(self, silent: Collection[NodeId]) -> Renderers:
        """The same, but for nodes that could not be reached just now."""
        sealing = {node: key for node, key in self.sealing.items() if node not in silent}
        return Renderers(sealing, (*self.left_out, *(LeftOut(node, SILENT) for node in self.sealing if node in silent)))

    def of_one_class(self, classes: Mapping[NodeId, str], wanted: str = "") -> Renderers:
        """The same, but for those that said that they render in another numeric class than `wanted`, or else than most that said one.

        `classes`: what nodes have said. Who said nothing stays; between equally many, the class of whoever comes first on the line does.
        """
        said = [classes[node] for node in self.sealing if classes.get(node)]
        if not said:
            return self
        kept = wanted if wanted in said else max(said, key=said.count)
        others = [node for node in self.sealing if classes.get(node, kept) not in (kept, "")]
        sealing = {node: key for node, key in self.sealing.items() if node not in others}
        return Renderers(sealing, (*self.left_out, *(LeftOut(node, OTHER_CLASS) for node in others)))

    def check_any(self, scene: str) -> None:
        """LocalFault, with what to do about it, if nobody may render."""
        if not self.sealing:
            why = "; ".join(f"{address_of(one.node)}: {one.why}" for one in self.left_out[:4]) or "the cluster has no member"
            raise LocalFault("no node may render this scene", where=f"scene {scene}; {why}", remedy=how_to_admit(scene))


def how_to_admit(scene: str) -> str:
    """What lets a node render a scene."""
    return (
        f"let a node render with `scenectl scene grant {scene} node:ADDRESS --role reader`, "
        "or every scene with `scenectl cluster trust ADDRESS`, or `--all`"
    )


def choose(view: LogView, grants: Sequence[Granted], certified: Mapping[NodeId, NodeKeys], problems: Mapping[NodeId, str]) -> Renderers:
    """Of the members, in the order of the line. `certified`: the keys in their certificates; `problems`: why there is none of a node."""
    sealing: dict[NodeId, SealingPublicKey] = {}
    left_out = []
    for node in view.members:
        keys = certified.get(node)
        why = problems.get(node, UNKNOWN) if keys is None else _obstacle(node, keys, view, grants)
        if not why and len(sealing) >= POOL_NODES_MAX:
            why = TOO_MANY
        if why or keys is None:
            left_out.append(LeftOut(node, why))
        else:
            sealing[node] = SealingPublicKey(keys.sealing)
    return Renderers(sealing, tuple(left_out))


def _obstacle(node: NodeId, keys: NodeKeys, view: LogView, grants: Sequence[Granted]) -> str:
    """Why a node may not render; empty if it may."""
    if view.roll.is_revoked(f"node:{node}", keys.signing_id):
        return REVOKED
    if keys != view.nodes.get(node):
        return OTHER_KEYS
    return "" if node in view.roll.trusted or any(_is_of(grant, node, keys) for grant in grants) else STRANGE


def _is_of(grant: Granted, node: NodeId, keys: NodeKeys) -> bool:
    """Whether a grant is for this node under these very keys."""
    granted = [(key.suite, key.raw) for key in (grant.signing, grant.sealing)]
    return grant.name == f"node:{node}" and granted == [(ED25519, raw) for raw in keys]
