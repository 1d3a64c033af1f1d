"""Why a node cannot leave at all, whatever it hands over (specs/13-balance.md, Leaving). Pure."""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.registry import Registry


def why_never(node: NodeId, registry: Registry, decides: Sequence[SceneId]) -> Refused | None:
    """What to say to who asks it to; None if it can. `decides`: scenes whose log it decides, alone or with others."""
    if node in registry.voters:
        return Refused(
            RejectReason.NOT_AUTHORISED,
            "this node decides the cluster's log, and the cluster cannot do without it",
            remedy=f"{_another_first(registry)}scenectl cluster remove-voter {address_of(node)}, then drain it",
        )
    issuers = registry.issuers
    if node in issuers and not any(registry.stands(other) for other in issuers - {node}):
        return Refused(
            RejectReason.NOT_AUTHORISED,
            "this is the only trusted node that has the authority's key, and without one nobody can join",
            remedy="trust another one first: scenectl cluster trust ADDRESS",
        )
    if decides:
        names = ", ".join(f"{scene:08x}" for scene in decides[:4]) + (" and others" if len(decides) > 4 else "")
        return Refused(
            RejectReason.NOT_AUTHORISED,
            f"this node decides what becomes of scene {names}",
            remedy=f"let the scene's owners have others decide in its place: `scenectl scene relieve {address_of(node)}`",
        )
    return None


def _another_first(registry: Registry) -> str:
    return "" if len(registry.voters) > 1 else "have another node decide, too: scenectl cluster add-voter ADDRESS; then "
