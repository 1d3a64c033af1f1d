"""If this fails, a node that only stores a scene is given its keys when somebody renders it, or who may render gets no say in that."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import trio

from integration.scenectl_process import Done, running, scenectl
from loopback import addresses, free_ports, ports_option
from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.client import Cluster, Scene, connect
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.render.choice import STRANGE
from scenefold.render.client import StillOptions, StillResult, render_still
from scenefold.render.image_files import image_sha256
from scenefold.scene.log import EpochKeys
from scenefold.scene.sample import sample_scene_path
from scenefold.wire import Role

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""
NODES = addresses(3)
VOTER, GRANTED, STORING = (NodeId(node_id_of(address)) for address in NODES)
SMALL = StillOptions(width=48, height=27, samples=4)
LONG = StillOptions(width=320, height=180, samples=1024)

pytestmark = pytest.mark.timeout(360)


class Render:
    """A render that goes on until the block ends."""

    def __init__(self) -> None:
        self.traces = trio.Event()
        self.addresses: list[str] = []

    def tell(self, phase: str, done: int, _total: int) -> None:
        if phase == "render" and done:
            self.traces.set()


@asynccontextmanager
async def rendering(cluster: Cluster, scene: Scene) -> AsyncIterator[None]:
    """The nodes trace inside of the block."""
    render = Render()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(render_still, cluster, scene, LONG, render.tell)
        await render.traces.wait()
        yield
        nursery.cancel_scope.cancel()


def holds(pid: int, keys: EpochKeys) -> bool:
    """Whether a process has any of these keys in its memory."""
    with Path(f"/proc/{pid}/maps").open() as maps, Path(f"/proc/{pid}/mem").open("rb", buffering=0) as memory:
        for line in maps:
            place, rights, *_, name = [*line.split(), ""]
            if not rights.startswith("rw") or name.startswith("[v"):
                continue
            first, last = (int(number, 16) for number in place.split("-"))
            try:
                memory.seek(first)
                piece = memory.read(last - first)
            except OSError:  # a piece that was given back meanwhile
                continue
            if any(key in piece for key in keys.values()):
                return True
    return False


@asynccontextmanager
async def a_scene(folder: Path, *, trust: bool = False) -> AsyncIterator[tuple[LocalCluster, Cluster, Scene]]:
    with trio.fail_after(KERNELS_S):
        async with local_cluster(3, folder, ports=free_ports(), trust=trust) as nodes, connect(nodes.profile) as cluster:
            scene, _ = await cluster.scenes.import_file("sample", sample_scene_path())
            yield nodes, cluster, scene


def by(result: StillResult) -> list[str]:
    return [node["address"] for node in result.report["render_nodes"]]


async def still(cluster: Cluster, scene: Scene) -> tuple[str, list[str]]:
    """The image, and who has rendered it."""
    result = await render_still(cluster, scene, SMALL, lambda *_: None)
    return image_sha256(result.layers["beauty"]), by(result)


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="processes do not show their memory here")  # noqa: PTH110
async def test_keys_come_only_to_nodes_that_are_trusted_or_granted_the_scene(tmp_path: Path) -> None:
    async with a_scene(tmp_path) as (nodes, cluster, scene):
        assert await still(cluster, scene) == (picture := (await still(cluster, scene))[0], [NODES[0]])
        await scene.grant(await cluster.card_of(f"node:{GRANTED}"), Role.READER)
        assert await still(cluster, scene) == (picture, list(NODES[:2])), "the same image, by whoever may make it"
        keys = scene.access.identity.keys
        async with rendering(cluster, scene):
            held = {address: holds(nodes.pid(address) or 0, keys) for address in NODES}
        assert held == {NODES[0]: True, NODES[1]: True, NODES[2]: False}
        report = (await render_still(cluster, scene, SMALL, lambda *_: None)).report
        assert report["left_out"] == [{"address": NODES[2], "why": STRANGE}]


@pytest.mark.long
async def test_trust_that_is_withdrawn_during_a_render_counts_for_the_next(tmp_path: Path) -> None:
    async with a_scene(tmp_path, trust=True) as (_, cluster, scene):
        picture, everybody = await still(cluster, scene)
        assert everybody == list(NODES)
        async with rendering(cluster, scene):
            await cluster.membership.trust(STORING, trusted=False)
            assert await still(cluster, scene) == (picture, list(NODES[:2]))
        # A grant of one scene is enough, and ends as well.
        await scene.grant(await cluster.card_of(f"node:{STORING}"), Role.READER)
        assert await still(cluster, scene) == (picture, everybody)
        await scene.revoke(f"node:{STORING}")
        assert await still(cluster, scene) == (picture, list(NODES[:2]))


async def test_a_node_to_which_nothing_is_sealed_organises_nothing(tmp_path: Path) -> None:
    from scenefold.render.pool.request import RenderRequest
    from scenefold.render.sealed_keys import About, seal_keys
    from scenefold.wire import JobAnswer, StartJob

    async with local_cluster(3, tmp_path, ports=free_ports()) as nodes, connect(nodes.profile) as cluster:
        scene = await cluster.scenes.create("plain")
        identity, trusted = scene.access.identity, nodes.known.member(NODES[0])
        about = About(nodes.known.cluster_id, identity.genesis, 7)
        keys = seal_keys(identity.keys, {VOTER: trusted.sealing_key}, about, os.urandom)
        request = RenderRequest(7, identity.scene, identity.genesis, keys, SMALL.checked())
        answer = await cluster.calls.ask(address_of(STORING), StartJob(job=7, document=request.to_bytes()), JobAnswer)
        assert answer.reason == 12 and "not sealed to this node" in answer.text
        # Nor does one that a stranger to the scene sends it to, with a box that is another's.
        moved = RenderRequest(7, identity.scene, identity.genesis, type(keys)(((STORING, keys.boxes[0][1]),), keys.keys), SMALL.checked())
        answer = await cluster.calls.ask(address_of(STORING), StartJob(job=7, document=moved.to_bytes()), JobAnswer)
        assert answer.reason == 4


async def test_if_nobody_may_render_that_is_one_clear_error(tmp_path: Path) -> None:
    options = ("--remove-after", "15")
    async with local_cluster(2, tmp_path, ports=free_ports(), options=options) as nodes, connect(nodes.profile) as cluster:
        scene = await cluster.scenes.create("plain")
        # Somebody must have the authority's key, and is a node that has died since.
        await cluster.membership.trust(GRANTED)
        with trio.fail_after(30):
            while True:
                try:
                    await cluster.membership.trust(VOTER, trusted=False)
                    break
                except Refused:
                    await trio.sleep(0.1)
        await nodes.kill(NODES[1])
        with trio.fail_after(90):
            while GRANTED in (await cluster.log.newest()).members:  # noqa: ASYNC110 (what another process does)
                await trio.sleep(0.5)
        with pytest.raises(LocalFault, match="no node may render") as caught:
            await render_still(cluster, scene, SMALL, lambda *_: None)
        assert NODES[0] in caught.value.where and "scenectl scene grant plain" in caught.value.remedy


def test_the_commands_say_who_is_left_out_and_how_to_change_it(tmp_path: Path) -> None:
    def still_of(scene: str) -> Done:
        arguments = ["--scene", scene, "--sky", "0.5,0.6,0.7", "--size", "16x16", "--samples", "1", "-o", tmp_path / "o.exr", "--json"]
        return scenectl("render", "still", *arguments, profile=profile, limit_s=KERNELS_S)

    (tmp_path / "room.obj").write_text("v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nf 1 2 3 4\nf 1 2 6 5\n")
    with running("node", "local", "3", "--no-trust", "--folder", tmp_path / "c", "--ports", ports_option(*NODES), "--json") as (_, ready):
        profile = ready["profile"]
        assert scenectl("scene", "import", tmp_path / "room.obj", profile=profile).code == 0
        alone = still_of("room")
        assert alone.code == 0, alone.err
        assert f"note: 1 of 3 nodes render ({NODES[1]}, {NODES[2]}: neither trusted" in alone.err
        assert "scenectl scene grant room node:ADDRESS --role reader" in alone.err
        assert [one["address"] for one in alone.json["left_out"]] == list(NODES[1:]) and len(alone.json["render_nodes"]) == 1
        # As it says:
        granted = scenectl("scene", "grant", "room", f"node:{NODES[1]}", "--role", "reader", profile=profile)
        assert granted.code == 0, granted.err
        two = still_of("room")
        assert "note: 2 of 3" in two.err and two.json["image_sha256"] == alone.json["image_sha256"]
        trusted = scenectl("cluster", "trust", "--all", "--json", profile=profile)
        assert trusted.code == 0 and trusted.json == {"addresses": list(NODES[1:]), "trusted": True}
        assert scenectl("cluster", "trust", "--all", "--json", profile=profile).json["addresses"] == []
        everybody = still_of("room")
        assert "note:" not in everybody.err and everybody.json["left_out"] == [] and len(everybody.json["render_nodes"]) == 3
        assert everybody.json["image_sha256"] == alone.json["image_sha256"]
        for arguments in (["--all", "--withdraw"], [], [NODES[1], "--all"]):
            assert "whom to trust" in scenectl("cluster", "trust", *arguments, profile=profile).refusal(2)
