"""Who may render a scene, as a client finds it out (specs/19-jobs.md, Who may).

Whom the cluster trusts, and under which keys, says its log, which is asked of several nodes for each render: what one of them shows it can
only cut short, and not below what this profile has seen. Who is granted the scene says the scene's log, as its keeper has it now.
"""

from __future__ import annotations

import datetime
from functools import partial

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster, Scene
from scenefold.client.together import together
from scenefold.crypto import Card
from scenefold.render.choice import REVOKED, Renderers, choose
from scenefold.world.log_view import LogView, NodeKeys

_TRIES_MAX = 3


async def renderers_of(cluster: Cluster, scene: Scene) -> Renderers:
    """Who may render the scene now, and who is left out. Unreachable if the node that keeps the scene's log does not answer.

    For the keys that the scene's identity has as this returns, and no later ones: a choice that waits is made again before anything is sealed.
    """
    for _ in range(_TRIES_MAX):
        log = await scene.access.read_log()
        view = await cluster.log.newest()
        certified, problems = await _certified(cluster, view)
        # A newer header that was met meanwhile may have brought keys that those of the older log's grants must not have.
        if log.header.position >= scene.access.identity.position:
            return choose(view, log.state.grants.members, certified, problems)
    what = "the scene's log is older here than what is known of the scene, so who may render it is not known"
    raise Refused(RejectReason.NOT_READY, what, where=f"scene {scene.name}", remedy="render again in a moment")


async def _certified(cluster: Cluster, view: LogView) -> tuple[dict[NodeId, NodeKeys], dict[NodeId, str]]:
    """The keys that the authority certified, of each member; or why they are not known."""
    authority = await cluster.in_worker("import", cluster.profile.authority_certificate)
    now = datetime.datetime.fromtimestamp(cluster.calls.world.clock.wall(), datetime.UTC)
    # Made with the cluster, by who made the profile, or as the authority has signed in the charter.
    original = {one.node_id: NodeKeys(one.public_key.raw, one.sealing_key.raw) for one in cluster.profile.members}
    found: dict[NodeId, NodeKeys] = {}
    problems: dict[NodeId, str] = {}

    async def look(node: NodeId) -> None:
        card, keys = view.roll.card_of(f"node:{node}"), view.keys_of(node)
        if keys is None:
            problems[node] = REVOKED
        elif card is None and original.get(node) == keys:
            found[node] = keys
        else:
            try:
                shown = await cluster.card_of(f"node:{node}") if card is None else Card.verified(card.der, authority, now)
                found[node] = NodeKeys(shown.keys.signing.raw, shown.keys.sealing.raw)
            except (DamagedData, LocalFault, PeerFault, Refused, Unreachable) as problem:
                problems[node] = _words(problem)

    await together(partial(look, node) for node in view.members)
    return found, problems


def _words(problem: ScenefoldError) -> str:
    return f"its certificate: {problem.what}"
