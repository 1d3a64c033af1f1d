"""In the end all copies of all records are read, as `scenectl cluster health --prove` reads them (specs/17-simulation.md, Laws).

What has rotted is met by that, and must be healed wherever the disks of members have it sound. Read once more, nothing may be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import trio

from scenefold.base.ids import SpaceId, node_id_of
from scenefold.client.calls import Calls
from scenefold.client.proof import Finding, Proof
from scenefold.client.proving import Proving
from scenefold.client.proving_reads import NodeReads
from scenefold.client.proving_scenes import ShownScene
from scenefold.client.reencryption import Pace
from scenefold.client.scene import Scene
from scenefold.simulation import laws
from scenefold.simulation.calm import unrest
from scenefold.simulation.cluster import Cluster
from scenefold.simulation.copies_calm import Arcs, line_of, wanted_slots
from scenefold.simulation.copying import KEPT, KEPT_OBJECTS
from scenefold.simulation.disks import found_at
from scenefold.simulation.history import Place
from scenefold.simulation.rot import RottenCopy
from scenefold.world import open_links

HEALED_S_MAX = 90.0
"""What is asked of others is asked again after pauses of some seconds."""
LOOK_S = 1.0
REST_S_MAX = 120.0
REST_CHECKS = 3
MOVES_MAX = 3
"""Proofs that are made anew since a bound has moved; loads even out, so bounds come to rest."""
TOLD_MAX = 3


async def prove_copies(cluster: Cluster, scene: Scene) -> None:
    """Twice, with time to heal between; what is wrong then is violated. A proof during which a bound moved says nothing: copies follow."""
    if not cluster.watch.keeping.rules:
        return
    line = _line(cluster)
    async with open_links(cluster.net.world("user:prover")) as links:
        owners = [node.address for node in cluster.founding], [node.node_id for node in cluster.founding]
        calls = Calls(cluster.net.world("user:prover"), links, *owners)
        await _proof(calls, scene)
        with trio.move_on_after(HEALED_S_MAX):
            while any(_healable(cluster)):  # noqa: ASYNC110 - disks tell nobody
                await trio.sleep(LOOK_S)
        for copy in list(_healable(cluster))[:TOLD_MAX]:
            words = f"{_name(copy.place)} has rotted on n{copy.slot} and is not healed, though others have it"
            cluster.watch.violated(laws.HEALED, words, location=copy.place.location, slots=(copy.slot,))
        proof = await _proof(calls, scene)
        for _ in range(MOVES_MAX):
            if _line(cluster) == line:
                break
            await _rest(cluster)
            line = _line(cluster)
            proof = await _proof(calls, scene)
        _judge(cluster, scene, proof)


def _line(cluster: Cluster) -> Arcs:
    return line_of(cluster.running.values())


async def _rest(cluster: Cluster) -> None:
    """Return once everything lies where it belongs by now, or that takes too long."""
    lasting = 0
    with trio.move_on_after(REST_S_MAX):
        while lasting < REST_CHECKS:
            await trio.sleep(LOOK_S)
            lasting = 0 if unrest(cluster) else lasting + 1


async def _proof(calls: Calls, scene: Scene) -> Proof:
    identity = scene.access.identity
    kept = {space: offsets for space, offsets in identity.layouts.offsets.items() if space in (KEPT, KEPT_OBJECTS)}
    layouts = replace(identity.layouts, offsets=kept)
    shown = ShownScene("simulated", identity.scene, identity.genesis, identity.position, identity.writers, layouts, identity.keys)
    return await Proving(calls, [shown], NodeReads(calls, Pace(None))).run()


def _judge(cluster: Cluster, scene: Scene, proof: Proof) -> None:
    rotten = {copy.place for copy in cluster.watch.rot.copies()}
    wrong = [f"n{cluster.slot_of(node_id_of(part.address))} does not list what it has: {part.why}" for part in proof.unlisted]
    for finding in proof.named:
        name, space = finding.key[2] if len(finding.key) == 3 else finding.key[1], SpaceId(finding.key[0])
        place = Place(scene.id, space, bytes(name))
        is_all = set(finding.placed) <= set(finding.valid) and len(finding.placed) < finding.wanted
        if place in rotten or cluster.watch.keeping.is_lied_about(place) or (is_all and not finding.is_corrupt):
            continue
        wrong.append(f"of {_name(place)} these are proved: {_words(cluster, finding)}")
    for words in wrong[:TOLD_MAX]:
        cluster.watch.violated(laws.COPIED_AGAIN, words)


def _healable(cluster: Cluster) -> Iterator[RottenCopy]:
    """What lies rotten where it must be, of which another that must have it has that version or a newer one, and is sound."""
    watch, line = cluster.watch, _line(cluster)
    for copy in watch.rot.copies():
        if not watch.keeping.has(copy.place):
            continue
        wanted = wanted_slots(cluster, line, copy.place)
        before = watch.rot.before(copy.slot, copy.place)
        if copy.slot not in wanted or before is None:
            continue
        for other in wanted:
            found = None if watch.rot.is_at(other, copy.place) else found_at(cluster.nodes[other].disk, copy.place)
            if found is not None and found.order >= before.order:
                yield copy
                break


def _words(cluster: Cluster, finding: Finding) -> str:
    said = ", ".join(f"n{cluster.slot_of(node)} {verdict}" for node, verdict in sorted(finding.verdicts.items()))
    placed = ", ".join(f"n{cluster.slot_of(node)}" for node in finding.placed)
    return f"{len(finding.valid)} of {finding.wanted} copies ({said}; on {placed})"


def _name(place: Place) -> str:
    return f"{place.location.hex()[:8]}… in space {place.space}"
