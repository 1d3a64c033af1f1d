"""If this fails, a network that is cut in two leaves two histories of a scene behind, or the smaller part of it does not say what is the matter."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Awaitable
from pathlib import Path
from typing import Any

import pytest
import trio

from integration.cut_networks import FIRST_ADDRESS, CutNetwork, cut_network
from integration.log_disks import check_one_history
from integration.scenectl_process import Done, environment
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.peer.timing import T_WAIT_S

NODES, FEW = 5, 2
TESTS = Path(__file__).resolve().parents[1]
LIMIT_S = 60.0
CAUGHT_UP_S_MAX = 120.0
"""For all nodes to have what a majority decided: each asks one of the others every 8 to 12 s, who may lack it as well."""
PAYLOAD = b"a place that both sides can read"

pytestmark = pytest.mark.slow


class Desk:
    """A computer beside a node, with a profile of its own: what is met here nobody knows elsewhere."""

    def __init__(self, network: CutNetwork, address: str, profile: Path) -> None:
        self._network, self._address, self._profile = network, address, profile

    async def scenectl(self, *words: str, stdin: bytes = b"") -> Done:
        command = self._network.on(self._address, sys.executable, "-m", "scenectl", *words)
        with trio.fail_after(LIMIT_S):
            done = await trio.run_process(
                command, stdin=stdin, capture_stdout=True, capture_stderr=True, check=False, env=environment(self._profile)
            )
        return Done(done.returncode, done.stdout, done.stderr.decode())

    async def json(self, *words: str, stdin: bytes = b"") -> Any:
        done = await self.scenectl(*words, "--json", stdin=stdin)
        assert done.code == 0, done.err
        return json.loads(done.out)

    async def makes(self, space: str) -> Done:
        return await self.scenectl("space", "create", space, "--scene", "stage", "--dimensions", "3")

    async def waits_for_all(self, nodes: LocalCluster, genesis: str, position: int) -> None:
        """Until each node has itself decided the log up to there, as nobody is sure to have but a majority."""
        words = (str(nodes.profile), genesis, str(position), *nodes.addresses)
        command = self._network.on(self._address, sys.executable, "-m", "integration.log_positions", *words)
        with trio.fail_after(CAUGHT_UP_S_MAX):
            await trio.run_process(command, env=environment(self._profile))

    async def spaces(self) -> set[str]:
        return {space["name"] for space in (await self.json("space", "list", "--scene", "stage"))["spaces"]}


@pytest.mark.timeout(600)
async def test_a_network_cut_in_two_has_one_history(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(TESTS), prepend=os.pathsep)
    with cut_network(NODES, monkeypatch) as network:
        running = local_cluster(NODES, tmp_path, first_address=FIRST_ADDRESS, module="integration.apart_node", trust=True)
        async with running as nodes:
            few, many = nodes.addresses[:FEW], nodes.addresses[FEW:]
            there = Desk(network, many[0], nodes.profile)
            made = await there.json("scene", "create", "stage", "--participants", str(NODES), "--copies", str(NODES))
            await there.json("data", "put", "files", "0a", "-", "--scene", "stage", stdin=PAYLOAD)
            here, beside = (Desk(network, few[at], Path(shutil.copytree(nodes.profile, tmp_path / f"computer {at}"))) for at in (0, 1))
            assert await here.spaces() == await there.spaces()

            network.cut_off(*few)
            begin = trio.current_time()
            said: list[Done] = []
            async with trio.open_nursery() as nursery:

                async def tries(work: Awaitable[Done]) -> None:
                    said.append(await work)

                nursery.start_soon(tries, here.makes("refused"))
                nursery.start_soon(tries, beside.scenectl("scene", "mode", "stage", "render"))
            print(f"both refused after {trio.current_time() - begin:.1f} s: {said[0].error}, {said[1].error}", flush=True)
            for refused in said:
                # Who was asked just after the cut may have exposed the change to those on his side: then it is in doubt, until both are one.
                said_so = "no majority of the nodes that decide the scene's log could be reached: 3 of 5 must agree" in refused.error
                assert (refused.code == 4 and said_so) or (refused.code == 3 and "it may have happened" in refused.error), refused.error
            before = await here.spaces()
            assert "refused" not in before
            assert (await here.json("scene", "log", "stage"))["position"] == 1
            got = await here.scenectl("data", "get", "files", "0a", "--scene", "stage", "--any-copy", "--output", str(tmp_path / "got"))
            assert got.code == 0 and (tmp_path / "got").read_bytes() == PAYLOAD, got.err
            # Leases of before the cut are over by then, and nobody gets another one: so nothing is signed, and there is no doubt about it.
            await trio.sleep_until(begin + T_WAIT_S)
            edited = await beside.scenectl("data", "put", "files", "0b", "-", "--scene", "stage", stdin=b"an edit of the few")
            for words in (
                "none of the 5 nodes that decide it lends a lease for edits",
                "3 of them must hear each other",
                "nothing was written",
            ):
                assert edited.code == 4 and words in edited.error, edited.err
            begin = trio.current_time()
            done = await there.makes("decided")
            print(f"decided by the others after {trio.current_time() - begin:.1f} s", flush=True)
            assert done.code == 0, done.err
            assert await here.spaces() == before

            network.heal()
            begin = trio.current_time()
            with trio.fail_after(LIMIT_S):
                while "decided" not in await here.spaces():
                    pass
            print(f"seen here {trio.current_time() - begin:.1f} s after the cut is over", flush=True)
            done = await here.makes("together")
            assert done.code == 0, done.err
            got = await there.scenectl("data", "get", "files", "0b", "--scene", "stage", "--output", str(tmp_path / "none"))
            assert got.code != 0 and not (tmp_path / "none").exists(), "what was refused to the few is nowhere"
            found = await there.spaces()
            assert {"decided", "together"} <= found
            # What is refused never comes; of what nobody knows it is in the log once, or not at all.
            assert "refused" not in found or {done.code for done in said} & {3}
            log = await there.json("scene", "log", "stage")
            await there.waits_for_all(nodes, made["genesis"], log["position"])
            for address in nodes.addresses:
                await nodes.stop(address)
        newest = check_one_history((nodes.folder / "data" / address for address in nodes.addresses), bytes.fromhex(made["genesis"]), {})
        assert newest == log["position"]
