"""To let a node decide no scene any more: before it leaves, or once it is gone for good (specs/16-scene-log.md, Who takes part).

A node that is gone counts on in every majority, so it is removed first, and another one takes its place then: of five with one dead four are
left, of which three must agree; to add one first would make six of them, of which four must, and only five live.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from scenefold.base.errors import LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.client.offers import no_change_left, one_change_left
from scenefold.client.trusted import able, entry_of
from scenefold.scene.log import changes_left
from scenefold.wire import SceneLogPublic, SceneMode

if TYPE_CHECKING:
    from scenefold.client.cluster import Cluster
    from scenefold.world.log_view import LogView


_NO_KEY = "you have no key of it: ask one of its owners"


@dataclass(frozen=True, slots=True)
class Relieved:
    """One scene that it decided, or observed. `by`: who decides in the node's place; None: nobody, fewer decide. `problem`: why the node decides on, or nobody came in its place."""

    scene: SceneId
    name: str | None
    by: NodeId | None = None
    problem: str = ""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        by = None if self.by is None else address_of(self.by)
        return {"scene": f"{self.scene:08x}", "name": self.name, "by": by, "problem": self.problem}


async def relieve(cluster: Cluster, node: NodeId, by: NodeId | None = None, *, dry_run: bool = False) -> list[Relieved]:
    """Have others decide in a node's place, in all scenes that we own. `by`: who, where that is possible; else another trusted node that decides not yet.

    What does not go for one scene is told of it, and the others go on. LocalFault if `by` is not trusted. `dry_run`: only say what would be done.
    """
    view = await cluster.log.newest()
    if by is not None:
        entry_of(view, by)
    names = {scene.genesis: scene.name for scene in await cluster.scenes.list()}
    found = []
    for header in await cluster.scenes.headers():
        if header.mode is SceneMode.ENDED:
            continue
        if any(entry.member.node == node for entry in header.observers):
            found.append(await _unobserved(cluster, names.get(header.genesis), header.scene, node, dry_run=dry_run))
        if node not in _deciding(header):
            continue
        name, heir = names.get(header.genesis), _heir(header, view, node, by, cluster.calls.is_silent)
        problem = _hopeless(header, name, node, heir)
        if not problem and not dry_run and name is not None:
            problem = await _replaced(cluster, name, header, view, node, heir)
        found.append(Relieved(header.scene, name, None if problem else heir, problem))
    return found


async def _unobserved(cluster: Cluster, name: str | None, scene: SceneId, node: NodeId, *, dry_run: bool) -> Relieved:
    """Nobody observes in its place: who is there no more only has each change of the mode wait."""
    problem = "" if name is not None else _NO_KEY
    if name is not None and not dry_run:
        try:
            await (await cluster.scenes.open(name)).remove_observer(node)
        except (LocalFault, Refused, Unreachable, PeerFault) as failure:
            problem = str(failure)
    return Relieved(scene, name, None, problem)


async def _replaced(cluster: Cluster, name: str, header: SceneLogPublic, view: LogView, node: NodeId, heir: NodeId | None) -> str:
    """Why not; empty if it is done."""
    try:
        scene = await cluster.scenes.open(name)
        if len(header.participants) > 1:
            await scene.remove_participant(node)
        if heir is not None:
            await scene.add_participants([entry_of(view, heir)])
        if len(header.participants) == 1:
            await scene.remove_participant(node)
    except (LocalFault, Refused, Unreachable, PeerFault) as problem:
        return str(problem)
    return ""


def _heir(header: SceneLogPublic, view: LogView, node: NodeId, by: NodeId | None, is_silent: Any) -> NodeId | None:
    """Who takes the place; None if nobody can."""
    taking_part = {*_deciding(header), *(entry.member.node for entry in header.observers)}
    if by is not None:
        return by if by not in taking_part else None
    others = [other for other in able(view) if other != node and other not in taking_part]
    return min(others, key=lambda other: (is_silent(other), other), default=None)


def _hopeless(header: SceneLogPublic, name: str | None, node: NodeId, heir: NodeId | None) -> str:
    """Why not to begin; empty if it may come to its end."""
    if not header.participants:
        return "it is decided where scenes of this cluster begin; `scenectl scene add-participant` lets others do so"
    if name is None:
        return _NO_KEY
    if heir is None and len(header.participants) == 1:
        return "nobody else is trusted who could decide it"
    left = changes_left(header)
    if not left:
        return str(no_change_left(name))
    if left == 1 and heir is not None:
        # Who is removed first, and then cannot be replaced, leaves one fewer for ever.
        return str(one_change_left(name, node if len(header.participants) > 1 else None))
    return ""


def _deciding(header: SceneLogPublic) -> Collection[NodeId]:
    nodes: Sequence[NodeId] = [NodeId(entry.member.node) for entry in header.participants]
    return nodes or [NodeId(header.origin)]
