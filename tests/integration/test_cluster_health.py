"""If this fails, nobody hears in time that copies are missing, or a proof says so of a cluster that has them all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import trio

from integration.living_clusters import LOOK_S, SPACE, Kept, Living, living_cluster
from integration.scenectl_process import Done, scenectl
from scenefold.base.prefixes import address_prefix
from scenefold.client import ClusterHealth, Condition

PATIENCE_S = 60.0
RECORDS = 40


async def verb(living: Living, *options: str) -> Done:
    """`scenectl cluster health`, as a process of its own."""
    call = partial(scenectl, "cluster", "health", "--json", *options, profile=living.nodes.profile, limit_s=2 * PATIENCE_S)
    return await trio.to_thread.run_sync(call)


async def until(living: Living, wanted: Callable[[ClusterHealth], bool]) -> ClusterHealth:
    """The first time that it is so."""
    found: ClusterHealth | None = None
    with trio.move_on_after(PATIENCE_S):
        while True:
            found = await living.cluster.health()
            if wanted(found):
                return found
            await trio.sleep(LOOK_S)
    raise AssertionError(f"not so: {None if found is None else found.document()}")


async def test_copies_are_proved_and_missed_as_soon_as_a_node_is_gone(tmp_path: Path) -> None:
    async with living_cluster(tmp_path, 4) as living:
        await living.at_rest(4)
        scene = await living.cluster.scenes.open("kept")
        await Kept(await scene.create_space("shelf", copies=3, copies_min=2)).put_evenly(RECORDS, 2_000)
        await until(living, lambda health: health.condition is Condition.HEALTHY)
        sound = await verb(living, "--prove", "--scene", "kept")
        assert sound.code == 0, sound.json
        assert (sound.json["status"], sound.json["records_with_copies"], sound.json["seconds_to_health"]) == ("healthy", RECORDS, 0.0)
        proof = sound.json["proof"]
        assert proof["copies"] == [{"wanted": 3, "valid": 3, "domains": 3, "elsewhere": 0, "records": RECORDS}]
        assert (proof["sound"], proof["opened"], proof["named"]) == (True, RECORDS, [])

        gone = living.nodes.addresses[-1]
        owned = next(node["copies"]["owned"] for node in sound.json["nodes"] if node["address"] == gone)
        await living.nodes.kill(gone)
        missed = await until(living, lambda health: health.under_copied > 0)
        assert missed.condition is Condition.DEGRADED and missed.seconds_to_health is None
        short = await verb(living, "--prove")
        assert short.code == 5
        assert (short.json["status"], short.json["nodes"][-1]["alive"]) == ("degraded", False)
        assert {"missing", "under-copied"} <= {ailment["kind"] for ailment in short.json["ailments"]}
        proof = short.json["proof"]
        assert [one["address"] for one in proof["unlisted"]] == [gone], "what it owned nobody can list now"
        assert (proof["records"], proof["lost"], proof["corrupt"]) == (RECORDS - owned, 0, 0)
        assert {(one["wanted"], one["valid"]) for one in proof["copies"]} <= {(3, 3), (3, 2)} and proof["short"] > 0
        assert all(finding["nodes"][gone] == "silent" for finding in proof["named"])


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.long
async def test_more_are_lost_at_once_than_copies_can_bear_and_that_is_said_until_it_is_acknowledged(tmp_path: Path) -> None:
    async with living_cluster(tmp_path, 5, options=("--remove-after", "13")) as living:
        await living.at_rest(5)
        scene = await living.cluster.scenes.open("kept")
        await Kept(await scene.create_space("shelf", copies=3, copies_min=2)).put_evenly(RECORDS, 2_000)
        await until(living, lambda health: health.condition is Condition.HEALTHY)
        gone = living.nodes.addresses[-2:]
        for address in gone:
            await living.nodes.kill(address)
        await until(living, lambda health: bool(health.losses) and {one.kind for one in health.ailments if one.degrades} == {"lost"})
        lost = await verb(living, "--prove")
        assert (lost.code, lost.json["status"], lost.json["proof"]["sound"]) == (5, "degraded", True)
        assert all({*loss["removed"]} <= {*gone} for loss in lost.json["lost"])
        assert 0 < sum(loss["share"] for loss in lost.json["lost"]) < 1
        seen = await verb(living, "--acknowledge")
        assert (seen.code, seen.json["lost"]) == (0, [])
        assert seen.json["acknowledged"] == [loss["id"] for loss in lost.json["lost"]]


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.long
async def test_one_node_says_what_is_missing_and_copies_are_made_as_others_join_and_go(tmp_path: Path) -> None:
    async with living_cluster(tmp_path, 1, spares=2) as living:
        scene = await living.cluster.scenes.create("own")
        kept = Kept(scene.space(SPACE))
        await kept.put_evenly(RECORDS, 2_000)
        alone = await verb(living)
        assert (alone.code, [ailment["kind"] for ailment in alone.json["ailments"]]) == (5, ["too few nodes"])
        assert "with 3 copies only 1 of them" in alone.json["ailments"][0]["text"] and "add 2 nodes" in alone.json["ailments"][0]["to_do"]
        status = await trio.to_thread.run_sync(partial(scenectl, "cluster", "status", profile=living.nodes.profile))
        assert status.code == 0 and "with 3 copies only 1 of them" in status.out.decode(), status.out
        async with trio.open_nursery() as writing:
            writing.start_soon(kept.go_on_writing)
            for spare in living.nodes.spares:
                living.nodes.start(spare)
            await until(living, lambda health: health.shortage is None and len(health.status.nodes) == 3)
            writing.cancel_scope.cancel()
        assert kept.lost_answers == 0, "nobody who joins holds up those who write"
        whole = await until(living, lambda health: health.condition is Condition.HEALTHY)
        assert sum(copies.copied for copies in whole.reports) >= len(kept.records)
        for left_over, spare in zip((2, 1), living.nodes.spares, strict=True):
            await living.cluster.drain(spare)
            await living.at_rest(left_over)
        await kept.check()
        await until(living, lambda health: health.shortage is not None and health.shortage.possible == 1)


def waits(health: ClusterHealth) -> list[str]:
    """What is said to come by itself."""
    return [ailment.kind for ailment in health.ailments if ailment.mends_itself or ailment.to_do.startswith("wait")]


async def test_where_blacklists_leave_no_holder_they_are_named_and_nobody_is_told_to_wait(tmp_path: Path) -> None:
    async with living_cluster(tmp_path, 3) as living:
        first, second, third = living.nodes.addresses
        scene = await living.cluster.scenes.open("kept")
        await Kept(await scene.create_space("shelf", copies=3, copies_min=2)).put_evenly(RECORDS, 200)
        rules = {first: "127.0.0.0/8", second: "0.0.0.0/0"}
        for address, prefix in rules.items():
            await living.cluster.blacklist(address, add=[address_prefix(prefix)])
        # What the last write still owed may be on its way for a moment.
        found = await until(living, lambda health: all(copies.shortages for copies in health.reports[:2]) and not waits(health))
        assert found.condition is Condition.DEGRADED and found.seconds_to_health is None
        few = {ailment.address: ailment for ailment in found.ailments if ailment.kind == "too few nodes"}
        assert few.keys() == rules.keys()
        for address, prefix in rules.items():
            assert f"{prefix} on its blacklist forbids" in few[address].text and third in few[address].text
            assert f"scenectl node blacklist rm {prefix} --node {address}" in few[address].to_do
        for address, prefix in rules.items():
            await living.cluster.blacklist(address, remove=[address_prefix(prefix)])
        await until(living, lambda health: health.condition is Condition.HEALTHY)
