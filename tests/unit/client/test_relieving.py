"""If this fails, a node that leaves goes on counting where scenes are decided, or a scene is left with nobody to decide it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client.relieving import Relieved, relieve
from scenefold.crypto import SigningKey
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil, taking_part

A, B, C, D, E = FIVE
OTHER = SigningKey(bytes(31) + b"\7")


def cluster_of(council: FakeCouncil, folder: Path) -> Any:
    scenes = council.scenes(Keyring(folder))
    return SimpleNamespace(scenes=scenes, calls=scenes._calls, log=SimpleNamespace(newest=council.newest_view))


async def deciders(cluster: Any, name: str) -> list[NodeId]:
    return list((await (await cluster.scenes.open(name)).deciders()).participants)


async def test_another_trusted_node_comes_in_its_place_in_each_scene(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil(trusted=(A, B, C, D))
    cluster = cluster_of(council, tmp_path)
    for name, participants in (("kitchen", (A, B, C)), ("hall", (B, C, D)), ("attic", (A, C, D)), ("all", (A, B, C, D)), ("alone", (B,))):
        await cluster.scenes.create(name, participants=taking_part(*participants))
    strangers = council.scenes(Keyring(tmp_path / "strangers"), OTHER)
    await strangers.create("theirs", participants=taking_part(A, B, C))
    planned = await relieve(cluster, node_id_of(B), dry_run=True)
    assert await deciders(cluster, "kitchen") == taking_part(A, B, C), "nothing was changed"
    done = {one.name: one for one in await relieve(cluster, node_id_of(B))}
    assert {one.name: one.by for one in planned} == {name: one.by for name, one in done.items()}
    assert {name: one.by for name, one in done.items()} == {
        "kitchen": node_id_of(D),
        "hall": node_id_of(A),
        "all": None,
        "alone": node_id_of(A),
        None: None,
    }
    assert "no key of it" in done[None].problem and not any(one.problem for name, one in done.items() if name)
    assert await deciders(cluster, "kitchen") == taking_part(A, C, D) == await deciders(cluster, "all")
    assert await deciders(cluster, "alone") == taking_part(A)
    assert [one.name for one in await relieve(cluster, node_id_of(B))] == [None]


async def test_one_that_is_gone_is_replaced_by_whoever_is_named(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil(trusted=(A, B, C, E))
    cluster = cluster_of(council, tmp_path)
    await cluster.scenes.create("kitchen", participants=3)
    council.away = {B}
    with pytest.raises(LocalFault, match="not trusted"):
        await relieve(cluster, node_id_of(B), node_id_of(D))
    (done,) = await relieve(cluster, node_id_of(B), node_id_of(E))
    assert (done.by, done.problem) == (node_id_of(E), "")
    assert await deciders(cluster, "kitchen") == taking_part(A, C, E)


async def test_what_cannot_be_done_is_told_and_left(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil(trusted=(A, B))
    cluster = cluster_of(council, tmp_path)
    await cluster.scenes.create("origins")
    await cluster.scenes.create("pair", participants=taking_part(A, B))
    (origins, pair) = sorted(await relieve(cluster, node_id_of(A)), key=lambda one: one.name or "")
    assert "where scenes of this cluster begin" in origins.problem
    assert (pair.problem, pair.by) == ("", None) and await deciders(cluster, "pair") == taking_part(B)
    council.trusted = (B,)
    (pair,) = await relieve(cluster, node_id_of(B))
    assert pair == Relieved(pair.scene, "pair", None, "nobody else is trusted who could decide it")
    assert pair.document()["problem"]
    council.trusted, council.away = (A, B), {B}
    (pair,) = await relieve(cluster, node_id_of(B))
    assert "answers and has the newest" in pair.problem and await deciders(cluster, "pair") == taking_part(B)


def may_change(times: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """So often in a scene's life, its first participants counted."""
    for module in ("scene.log.certified", "peer.scene_log.scene_judge", "client.offers"):
        monkeypatch.setattr(f"scenefold.{module}.CHANGES_MAX", times)


async def test_nobody_is_removed_who_could_not_be_replaced_any_more(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_change(4, monkeypatch)
    council = FakeCouncil(trusted=(A, B, C, D))
    cluster = cluster_of(council, tmp_path)
    await cluster.scenes.create("kitchen", participants=taking_part(A, B, C))
    scene = await cluster.scenes.open("kitchen")
    await scene.add_participants([council.entry(node_id_of(E))])
    assert (await scene.deciders()).changes_left == 2
    (planned,) = await relieve(cluster, node_id_of(B), dry_run=True)
    assert (planned.by, planned.problem) == (node_id_of(D), ""), "two are enough"

    found = await scene.remove_participant(node_id_of(E))
    assert found.document()["changes_left"] == 1
    for dry_run in (True, False):
        (told,) = await relieve(cluster, node_id_of(B), dry_run=dry_run)
        assert told.by is None and "once more in its life, and to replace one of them takes two changes" in told.problem
        assert f"scene remove-participant kitchen {B}` lets it" in told.problem and "scene export kitchen kitchen.tar" in told.problem
    assert await deciders(cluster, "kitchen") == taking_part(A, B, C)
    assert (await scene.remove_participant(node_id_of(B))).changes_left == 0
    with pytest.raises(
        Refused, match=r"have changed 4 times, as often as they can in its life.*scene import-archive kitchen\.tar"
    ) as refused:
        await scene.add_participants([council.entry(node_id_of(D))])
    assert refused.value.reason is RejectReason.LIMIT_EXCEEDED
    (told,) = await relieve(cluster, node_id_of(C))
    assert "have changed 4 times" in told.problem
    assert await deciders(cluster, "kitchen") == taking_part(A, C)


async def test_the_last_one_that_cannot_be_replaced_decides_on(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_change(2, monkeypatch)
    cluster = cluster_of(FakeCouncil(trusted=(A, B)), tmp_path)
    await cluster.scenes.create("kitchen", participants=taking_part(A))
    (told,) = await relieve(cluster, node_id_of(A))
    assert "takes two changes" in told.problem and "remove-participant" not in told.problem
    assert await deciders(cluster, "kitchen") == taking_part(A)
