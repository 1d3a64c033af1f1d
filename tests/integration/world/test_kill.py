"""If this failed, whoever asks a node that dies would wait for its timeout, or for ever."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import trio

from conformance.world.makers import RealWorlds
from scenefold.base.errors import Unreachable
from scenefold.wire import RequestTable
from scenefold.world import Priority, open_links

NODE = """
import sys
from pathlib import Path
import trio
from scenefold.crypto import Identity
from scenefold.world import Ports, Priority, real_world, serve_connection

async def hang(packet, peer):
    print("asked", flush=True)
    await trio.sleep_forever()

async def main():
    world = real_world(Identity.from_files(Path({folder!r})), Path({authority!r}).read_bytes(), ports=Ports({low}, {high}))
    async with trio.open_nursery() as nursery:
        await nursery.start(world.network.listen, {address!r}, Priority.LOW, lambda connection: serve_connection(connection, hang))
        print("listening", flush=True)

trio.run(main)
"""


def start_node(worlds: RealWorlds, folder: Path) -> subprocess.Popen[bytes]:
    worlds.identity(0).to_files(folder / "node")
    (folder / "authority.pem").write_bytes(worlds.authority.certificate)
    script = NODE.format(
        folder=str(folder / "node"),
        authority=str(folder / "authority.pem"),
        low=worlds.ports.low,
        high=worlds.ports.high,
        address=worlds.address(0),
    )
    return subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)


async def test_a_node_that_is_killed_is_noticed_at_once(tmp_path: Path) -> None:
    worlds = RealWorlds()
    failures = []

    with start_node(worlds, tmp_path) as process:
        assert process.stdout is not None
        assert await trio.to_thread.run_sync(process.stdout.readline) == b"listening\n"
        async with open_links(worlds.user("ada")) as links:

            async def ask() -> None:
                with pytest.raises(Unreachable) as caught:
                    await links.request(worlds.address(0), Priority.LOW, RequestTable(request_id=0, mini_status=None), 60.0)
                failures.append(caught.value)

            with trio.fail_after(30):
                async with trio.open_nursery() as nursery:
                    for _ in range(5):
                        nursery.start_soon(ask)
                    for _ in range(5):
                        assert await trio.to_thread.run_sync(process.stdout.readline) == b"asked\n"
                    process.kill()
            assert len(failures) == 5
            assert all("the connection" in failure.what for failure in failures)
            await trio.to_thread.run_sync(process.wait)
            await ask()
            assert "refused" in failures[-1].what.lower()
