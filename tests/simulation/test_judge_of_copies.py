"""If this fails, copies can be missing, rot unhealed, custody left over or stores damaged when a storm is over, and nobody says so."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from random import Random

import pytest
import trio

from scenefold.base.location import Location
from scenefold.client.calls import Calls
from scenefold.client.proof import Proof
from scenefold.client.scene import Scene
from scenefold.peer.line.ends import Side
from scenefold.peer.replication.healing import Healing
from scenefold.simulation import laws, proof
from scenefold.simulation.calm import unrest
from scenefold.simulation.clients import keep_copies
from scenefold.simulation.copies_calm import wrong_copies
from scenefold.simulation.copying import KEPT, Copying
from scenefold.simulation.disks import arc_of, place_of
from scenefold.simulation.history import Place
from scenefold.simulation.proof import prove_copies
from scenefold.simulation.whole import judge_stores
from scenefold.store.layout import RECORDS, STATISTICS
from simulation.quiet import Rest, at_rest, overwrite

pytestmark = pytest.mark.usefixtures("silent")
FOUNDERS = {0, 1, 2}


def with_copies(look: Callable[[Rest, Place], Awaitable[None]], copies: int = 3) -> None:
    """Look at a cluster at rest in which a record of n0 has so many copies."""

    async def play(rest: Rest) -> None:
        await keep_copies(rest.scene, Copying(copies, 2, 0), rest.cluster.watch)
        await rest.scene.space(KEPT).put(rest.places[0], b"kept")
        while unrest(rest.cluster):  # noqa: ASYNC110 - disks tell nobody
            await trio.sleep(0.5)
        await look(rest, Place(rest.scene.id, KEPT, rest.places[0]))

    at_rest(play)


def rot(rest: Rest, place: Place, slot: int) -> None:
    watch, disk = rest.cluster.watch, rest.cluster.nodes[slot].disk
    before = watch.records(slot)
    (key,) = (key for key in disk.peek(RECORDS) if place_of(key) == place)
    disk.corrupt(RECORDS, Random(slot), key)
    watch.damaged(slot, key, before)


def laws_of(rest: Rest) -> set[str]:
    return {found.law for found in rest.cluster.watch.violations}


def test_what_has_rotted_is_met_by_a_proof_and_healed() -> None:
    async def look(rest: Rest, place: Place) -> None:
        rot(rest, place, 0)
        rot(rest, place, 1)
        await prove_copies(rest.cluster, rest.scene)
        assert not laws_of(rest) and not list(rest.cluster.watch.rot.copies())

    with_copies(look)


def test_what_nobody_heals_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Healing, "rotten", lambda *_: None)

    async def look(rest: Rest, place: Place) -> None:
        rot(rest, place, 1)
        await prove_copies(rest.cluster, rest.scene)
        assert laws_of(rest) == {laws.HEALED}

    with_copies(look)


def test_a_copy_that_is_missing_is_met_by_a_proof() -> None:
    async def look(rest: Rest, place: Place) -> None:
        (key,) = (key for key in rest.cluster.nodes[2].disk.peek(RECORDS) if place_of(key) == place)
        overwrite(rest.cluster.nodes[2].disk, RECORDS, key, None)
        await prove_copies(rest.cluster, rest.scene)
        assert laws_of(rest) == {laws.COPIED_AGAIN}

    with_copies(look)


def test_what_is_older_than_what_has_rotted_at_its_owner_is_missed_by_nobody() -> None:
    async def look(rest: Rest, place: Place) -> None:
        (key,) = (key for key in rest.cluster.nodes[2].disk.peek(RECORDS) if place_of(key) == place)
        older = bytes(rest.cluster.nodes[2].disk.peek(RECORDS)[key])
        await rest.scene.space(KEPT).put(rest.places[0], b"newer")
        while unrest(rest.cluster):  # noqa: ASYNC110 - disks tell nobody
            await trio.sleep(0.5)
        overwrite(rest.cluster.nodes[2].disk, RECORDS, key, older)
        overwrite(rest.cluster.nodes[1].disk, RECORDS, key, None)
        ((words, _slots),) = wrong_copies(rest.cluster, FOUNDERS)
        assert "is not on n1, n2" in words
        rot(rest, place, 0)
        assert not list(wrong_copies(rest.cluster, FOUNDERS))

    with_copies(look)


def test_copies_that_follow_a_bound_that_moves_during_a_proof_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    async def look(rest: Rest, _place: Place) -> None:
        giver = rest.cluster.nodes[1]
        prove, proofs = proof._proof, []

        async def proof_with_a_move(calls: Calls, scene: Scene) -> Proof:
            proofs.append(await prove(calls, scene))
            if len(proofs) == 1:
                # The copy's place, half a line away, is another node's from now on.
                arc = arc_of(giver.disk)
                assert arc is not None and giver.context is not None
                line, piece = giver.context.line, replace(arc, first=Location.from_number(arc.first.number + arc.length // 4))
                await trio.sleep(line._parts.settling.settles_in_s(piece))
                await line.give(Side.RIGHT, piece, why="a test")
            return proofs[-1]

        monkeypatch.setattr(proof, "_proof", proof_with_a_move)
        await prove_copies(rest.cluster, rest.scene)
        assert not laws_of(rest)
        assert not list(wrong_copies(rest.cluster, FOUNDERS))
        assert len(proofs) > 2

    with_copies(look, copies=2)


def test_custody_that_no_owner_speaks_of_is_told() -> None:
    async def look(rest: Rest, _place: Place) -> None:
        assert not list(wrong_copies(rest.cluster, FOUNDERS))
        context = rest.cluster.nodes[1].context
        assert context is not None
        keeper = context.line._parts.keeper

        def forget(copies, _holding):  # type: ignore[no-untyped-def]
            first, *others = copies.custody.entries
            return replace(copies, custody=replace(copies.custody, entries=(replace(first, number=first.number + 1), *others)))

        await keeper.change_copies(forget)
        ((words, slots),) = wrong_copies(rest.cluster, FOUNDERS)
        assert words.startswith("n1 ") and 1 in slots

    with_copies(look)


def test_a_store_with_wrong_counts_is_no_whole_one_and_one_with_rot_is() -> None:
    async def look(rest: Rest, place: Place) -> None:
        rot(rest, place, 1)
        judge_stores(rest.cluster)
        assert not laws_of(rest)
        disk = rest.cluster.nodes[2].disk
        overwrite(disk, STATISTICS, next(iter(disk.peek(STATISTICS))), None)
        judge_stores(rest.cluster)
        assert laws_of(rest) == {laws.WHOLE}

    with_copies(look)
