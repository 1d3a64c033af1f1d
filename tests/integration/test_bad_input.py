"""If this fails, a mistake in setting a cluster up, or a hostile peer, ends in a hang, a traceback, or a node that is gone."""

from __future__ import annotations

import shutil
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import trio

from integration.clusters import world_of_user
from integration.scenectl_process import running, scenectl
from loopback import addresses, ports_option
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire import Fault, FrameReader, ListScenes, ScenesListed, decode_packet, encode_frame
from scenefold.world import Connection, ConnectionLost, Priority
from scenefold.world.profile import ClusterProfile

ROOM = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nf 1 2 3 4\n"
HOST = addresses(1)[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Of a running cluster of one node: profile/, data/ and logs/."""
    where = tmp_path_factory.mktemp("one")
    with running("node", "local", "1", "--folder", where, "--ports", ports_option(HOST), "--json"):
        yield where


@pytest.fixture
def copy(folder: Path, tmp_path: Path) -> Path:
    """A copy of the running cluster's profile, to be damaged."""
    return Path(shutil.copytree(folder / "profile", tmp_path / "copy"))


def lives(folder: Path) -> bool:
    return scenectl("cluster", "status", profile=folder / "profile").code == 0


# Ports, addresses, folders --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM], ids=["TCP", "UDP"])
def test_a_port_in_use(kind: socket.SocketKind, tmp_path: Path) -> None:
    (tmp_path / "room.obj").write_text(ROOM)
    (tmp_path / "tmp").mkdir()
    ports = ports_option(*addresses(2))
    with socket.socket(socket.AF_INET, kind) as holder:
        holder.bind((addresses(2)[1], int(ports.split(",")[1])))
        if kind == socket.SOCK_STREAM:
            holder.listen()
        done = scenectl(
            *("render", "still", tmp_path / "room.obj", "--nodes", "2", "--ports", ports, "-o", tmp_path / "o.exr"),
            TMPDIR=str(tmp_path / "tmp"),
        )
    line = done.refusal(1)
    assert "in use" in line and addresses(2)[1] in line
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["room.obj", "tmp"]


def test_an_address_of_another_machine(tmp_path: Path) -> None:
    made = scenectl("cluster", "init", tmp_path / "far", "--nodes", "192.0.2.7")
    assert made.code == 0, made.err
    done = scenectl("node", "run", "--address", "192.0.2.7", "--data", tmp_path / "data", profile=tmp_path / "far")
    assert "192.0.2.7" in done.refusal(1)


def test_a_blacklist_that_is_too_long(folder: Path) -> None:
    listed = ",".join(f"10.0.1.{number}" for number in range(1, 34))
    done = scenectl("node", "run", "--address", HOST, "--blacklist", listed, profile=folder / "profile")
    assert (done.code, done.error) == (2, "error: a blacklist of 33 entries: give 32 at most")


def test_seeds_that_do_not_answer(tmp_path: Path) -> None:
    made = scenectl("cluster", "init", tmp_path / "two", "--nodes", ",".join(addresses(2)), "--ports", ports_option(*addresses(2)))
    assert made.code == 0, made.err
    node = ["node", "run", "--address", HOST, "--data", tmp_path / "data", "--seeds", "127.0.0.99", "--seed-wait", "0.5"]
    done = scenectl(*node, "--log-level", "error", profile=tmp_path / "two")
    assert "127.0.0.99" in done.refusal(3)


def test_a_cluster_that_is_not_running(tmp_path: Path) -> None:
    (tmp_path / "room.obj").write_text(ROOM)
    scenectl("cluster", "init", tmp_path / "two", "--nodes", ",".join(addresses(2)), "--ports", ports_option(*addresses(2)))
    still = ["render", "still", tmp_path / "room.obj", "-o", tmp_path / "o.exr"]
    line = scenectl(*still, profile=tmp_path / "two").refusal(3)
    assert all(address in line for address in addresses(2))
    assert not (tmp_path / "o.exr").exists()


def test_a_data_folder_that_cannot_be_written(folder: Path) -> None:
    done = scenectl("node", "run", "--address", HOST, "--data", "/proc/scenefold", profile=folder / "profile")
    assert "/proc/scenefold" in done.refusal(1)


def test_a_data_folder_that_is_in_use_or_a_file(folder: Path, tmp_path: Path) -> None:
    node = ["node", "run", "--address", HOST, "--data"]
    assert "in use" in scenectl(*node, folder / "data" / HOST, profile=folder / "profile").refusal(1)
    (tmp_path / "file").write_text("")
    assert "is a file" in scenectl(*node, tmp_path / "file", profile=folder / "profile").refusal(1)
    assert lives(folder)


def test_a_data_folder_of_another_node(tmp_path: Path) -> None:
    for name, address in (("mine", "127.0.0.2"), ("yours", "127.0.0.3")):
        assert scenectl("cluster", "init", tmp_path / name, "--nodes", address, "--ports", ports_option(address)).code == 0
    data = tmp_path / "data"
    with running("node", "run", "--address", "127.0.0.2", "--data", data, "--json", profile=tmp_path / "mine"):
        pass
    before = (data / "data.mdb").read_bytes()
    done = scenectl("node", "run", "--address", "127.0.0.3", "--data", data, profile=tmp_path / "yours")
    line = done.refusal(1)
    assert "belongs to node 127.0.0.2" in line
    assert (data / "data.mdb").read_bytes() == before


# Profiles -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("damaged", "content"),
    [
        ("cluster.toml", b"name = "),
        ("cluster.toml", b'format = 1\nname = "local"\n'),
        ("cluster.toml", b"\xff\xfe"),
        ("users/owner/key.pem", b"no key"),
        ("users/owner/certificate.pem", b"no certificate"),
        ("users/owner/signing.seed", b"short"),
        ("users/owner/signing.seed", None),
        ("users/owner/key.pem", None),
        ("authority/certificate.pem", None),
    ],
)
def test_a_damaged_profile(damaged: str, content: bytes | None, copy: Path) -> None:
    path = copy / damaged
    assert path.is_file(), sorted(copy.rglob("*"))
    path.unlink() if content is None else path.write_bytes(content)
    done = scenectl("scene", "create", "attic", profile=copy)
    line = done.refusal(1)
    assert path.name in line or "owner" in line


def test_keys_of_another_cluster(folder: Path, copy: Path, tmp_path: Path) -> None:
    """A profile that fits the addresses, but was not issued by the authority of these nodes."""
    stranger = ClusterProfile.create(tmp_path / "stranger", "local", [HOST], ports=ClusterProfile.load(copy).ports)
    done = scenectl("cluster", "status", profile=stranger.folder)
    assert "its certificate is not valid here" in done.refusal(3)
    shutil.rmtree(copy / "users")
    shutil.copytree(stranger.folder / "users", copy / "users")
    done = scenectl("cluster", "status", profile=copy)
    assert "the certificate is of another cluster" in done.refusal(1)
    assert lives(folder)


def test_a_signing_key_that_is_not_the_users_own(folder: Path, copy: Path, tmp_path: Path) -> None:
    assert scenectl("scene", "create", "hall", profile=folder / "profile").code == 0
    shutil.copy(folder / "profile" / "scenes" / "hall.toml", copy / "scenes" / "hall.toml")
    stranger = ClusterProfile.create(tmp_path / "stranger", "local", [HOST])
    shutil.copy(stranger.folder / "users" / "owner" / "signing.seed", copy / "users" / "owner" / "signing.seed")
    done = scenectl("data", "put", "files", "01", "-", "--scene", "hall", profile=copy, stdin=b"x")
    assert "these are not the keys that the certificate names" in done.refusal(1)
    assert scenectl("data", "ls", "files", "--scene", "hall", "--json", profile=folder / "profile").json["locations"] == []


# Frames ---------------------------------------------------------------------------------------------------------


async def connected(folder: Path) -> Connection:
    profile = ClusterProfile.load(folder / "profile")
    return await world_of_user(profile).network.connect(HOST, Priority.LOW)


async def answers(connection: Connection) -> list[object]:
    """All packets until the node closes."""
    reader, packets = FrameReader(), []
    with trio.fail_after(30):
        while data := await connection.receive(1 << 16):
            packets += [decode_packet(payload) for payload in reader.feed(data)]
    await connection.aclose()
    return packets


def log(folder: Path) -> str:
    return (folder / "logs" / f"{HOST}.log").read_text()


async def test_a_truncated_frame(folder: Path) -> None:
    connection = await connected(folder)
    await connection.send(encode_frame(ListScenes(request_id=7))[:-1])
    await connection.aclose()
    with trio.fail_after(30):
        while "user:owner: the connection ended within a frame" not in log(folder):
            await trio.lowlevel.checkpoint()
    assert lives(folder)


@pytest.mark.parametrize("length", [0, FRAME_BYTES_MAX + 1, 2**32 - 1])
async def test_a_frame_of_a_forbidden_length(length: int, folder: Path) -> None:
    connection = await connected(folder)
    await connection.send(struct.pack(">I", length) + b"x" * 64)
    (fault,) = await answers(connection)
    assert isinstance(fault, Fault) and fault.reason == RejectReason.LIMIT_EXCEEDED and f"{length} bytes" in fault.text
    assert "(frame.length)" in log(folder)
    assert lives(folder)


async def test_a_frame_of_noise_among_requests(folder: Path) -> None:
    """A frame that is no packet costs its sender that frame, and nothing else; many of them cost it the connection."""
    noise = struct.pack(">I", 5) + b"noise"
    connection = await connected(folder)
    await connection.send(noise + encode_frame(ListScenes(request_id=7)))
    with trio.fail_after(30):
        (answer,) = map(decode_packet, FrameReader().feed(await connection.receive(1 << 16)))
    assert isinstance(answer, ScenesListed) and answer.request_id == 7
    with suppress(ConnectionLost):  # Whether it is closed or reset depends on what the node had read.
        for _ in range(1000):
            await connection.send(noise)
        await answers(connection)
    await connection.aclose()
    assert "Traceback" not in log(folder) and "malformed packet" in log(folder)
    assert lives(folder)
