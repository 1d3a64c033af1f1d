"""If this fails, who has a node's disk or its log, or listens on the network, reads what they have no key for.

Two of the nodes render the scene, the one that is trusted and one that it was granted to: they hold its keys in memory, and may leave no
more on their disks and in their logs than the third, which only stores.
"""

from __future__ import annotations

import socket
from dataclasses import dataclass
from pathlib import Path

import pytest
from PIL import Image

from integration.loopback_capture import CARRIERS, Capture, captured
from integration.scenectl_process import running, scenectl
from loopback import ports_option

ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")
CHUNK_BYTES = 16 * 1024 * 1024
KERNELS_S = 300.0
"""The first render after a change of the kernels compiles them."""

SCENE, SPACE = "zebra-scene-7f31", "giraffe-space-9c02"
MATERIAL, OBJECT = "walrus-material-51aa", "ostrich-object-e8d4"
PAYLOAD, SECOND, DELETED = (f"{animal} payload ".encode() * 40 for animal in ("pelican", "gazelle", "mongoose"))
PIXELS = bytes((211, 7, 83, 5, 199, 31, 97, 13, 241)) * 8
MARKERS = {
    "the scene's name": SCENE.encode(),
    "a space's name": SPACE.encode(),
    "a material's name": MATERIAL.encode(),
    "an object's name": OBJECT.encode(),
    "a payload": PAYLOAD[:24],
    "a payload that was overwritten": SECOND[:24],
    "a payload that was deleted": DELETED[:24],
    "pixels of a texture": PIXELS[:27],
}
CONTROL = b"a stranger's words, which anybody may read"
TCP_BYTES, UDP_BYTES = 10_000, 2_000
"""What a cluster says at least on each port of TCP, and on that of its datagrams."""

pytestmark = pytest.mark.timeout(360)


@dataclass(frozen=True)
class Traces:
    """What a cluster that held the markers left."""

    capture: Capture
    ports: tuple[int, int]
    """Of low and of high priority; datagrams go to the latter."""
    data_folders: tuple[Path, ...]
    logs: tuple[Path, ...]


@pytest.fixture(scope="module")
def traces(tmp_path_factory: pytest.TempPathFactory) -> Traces:
    folder = tmp_path_factory.mktemp("trial")
    ports = ports_option(*ADDRESSES)
    low, high = map(int, ports.split(","))
    with captured(low, high) as capture:
        with running("node", "local", "3", "--no-trust", "--folder", folder, "--ports", ports, "--json") as (_, ready):
            profile = ready["profile"]
            _use(profile, folder)
            # Last, so that a capture that ended meanwhile lacks it.
            for port in (low, high):
                _say_in_the_clear((ADDRESSES[0], port))
    # All nodes have ended, so what they had in memory is on their disks.
    data_folders = tuple(sorted(path.parent for path in folder.rglob("data.mdb")))
    return Traces(capture, (low, high), data_folders, tuple(sorted((folder / "logs").iterdir())))


def _say_in_the_clear(address: tuple[str, int]) -> None:
    """By each carrier, whether anybody listens or not."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(CONTROL, address)
    with socket.create_connection(address) as stranger:
        stranger.sendall(CONTROL)


@pytest.fixture
def wire(traces: Traces) -> Capture:
    """All that passed; skips where nobody may look, fails if some of it was not seen."""
    if traces.capture.blind:
        pytest.skip(traces.capture.blind)
    if traces.capture.dropped:
        pytest.fail(f"{traces.capture.dropped} packets passed unseen: run this beside less, or raise net.core.rmem_max")
    return traces.capture


def _use(profile: str, folder: Path) -> None:
    def call(*arguments: str | Path, stdin: bytes = b"") -> bytes:
        done = scenectl(*arguments, profile=profile, stdin=stdin)
        assert done.code == 0, done.err
        return done.out

    model = _model(folder)
    call("scene", "import", model, "--scene", SCENE)
    call("space", "create", SPACE, "--scene", SCENE, "--box", "0,0,0:1,1,1")
    for place, payloads in {"0a": [PAYLOAD], "5f": [SECOND, PAYLOAD], "ff": [DELETED]}.items():
        for payload in payloads:
            call("data", "put", "files", place, "-", "--scene", SCENE, stdin=payload)
    call("data", "delete", "files", "ff", "--scene", SCENE)
    assert call("data", "get", "files", "5f", "--scene", SCENE) == PAYLOAD
    assert SCENE.encode() in call("scene", "list")
    assert SPACE.encode() in call("space", "list", "--scene", SCENE)
    _share(profile, folder / "ada")
    assert call("data", "get", "files", "a1", "--scene", SCENE) == PAYLOAD
    call("scene", "grant", SCENE, f"node:{ADDRESSES[1]}", "--role", "reader")
    _render(profile, folder)
    call("scene", "revoke", SCENE, "user:ada")
    call("data", "put", "files", "a2", "-", "--scene", SCENE, stdin=PAYLOAD)


def _share(profile: str, guest: Path) -> None:
    """A user joins, is granted the scene, and reads and writes it."""
    invited = scenectl("cluster", "invite", "--user", "ada", "--json", profile=profile)
    for arguments, whose in (
        (("cluster", "join", invited.json["token"]), guest),
        (("scene", "grant", SCENE, "user:ada", "--role", "writer"), profile),
        (("data", "put", "files", "a1", "-", "--scene", SCENE), guest),
    ):
        done = scenectl(*arguments, profile=whose, stdin=PAYLOAD)
        assert done.code == 0, done.err
    assert scenectl("data", "get", "files", "5f", "--scene", SCENE, profile=guest).out == PAYLOAD


def _render(profile: str, folder: Path) -> None:
    picture = ("--sky", "0.5,0.6,0.7", "--size", "16x16", "--samples", "1", "-o", folder / "o.exr", "--json")
    done = scenectl("render", "still", "--scene", SCENE, *picture, profile=profile, limit_s=KERNELS_S)
    assert done.code == 0, done.err
    assert [left["address"] for left in done.json["left_out"]] == [ADDRESSES[2]], "the others have its keys"


def _model(folder: Path) -> Path:
    Image.frombytes("RGB", (8, 3), PIXELS).save(folder / "texture.bmp")
    (folder / "model.mtl").write_text(f"newmtl {MATERIAL}\nKd 0.5 0.5 0.5\nmap_Kd texture.bmp\n")
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    (folder / "model.obj").write_text(f"mtllib model.mtl\no {OBJECT}\n{square}usemtl {MATERIAL}\nf 1/1 2/2 3/3 4/4\n")
    return folder / "model.obj"


@pytest.mark.parametrize("carrier", CARRIERS)
@pytest.mark.parametrize("priority", (0, 1), ids=("low", "high"))
def test_what_passes_in_the_clear_is_found_on_each_port(carrier: str, priority: int, traces: Traces, wire: Capture) -> None:
    """A stranger's words: else no test of the wire could fail."""
    port = traces.ports[priority]
    assert (CARRIERS[carrier], port) in [(flow[0], flow[4]) for flow in wire.found(CONTROL)], "the capture does not see this port"


def test_the_cluster_spoke_on_each_of_its_ports(traces: Traces, wire: Capture) -> None:
    low, high = traces.ports
    assert min(wire.bytes_of("tcp", port) for port in (low, high)) > TCP_BYTES
    assert wire.bytes_of("udp", high) > UDP_BYTES


def test_what_is_in_the_clear_on_disks_and_in_logs_is_found(traces: Traces) -> None:
    """Members' addresses: else the other tests could not fail."""
    assert len(traces.data_folders) == len(ADDRESSES)
    assert all(_holds(folder / "data.mdb", ADDRESSES[0].encode()) for folder in traces.data_folders)
    assert len(traces.logs) == len(ADDRESSES) and all(_holds(log, b"127.0.0.") for log in traces.logs)


@pytest.mark.parametrize("what", MARKERS)
def test_no_disk_of_a_node_holds(what: str, traces: Traces) -> None:
    holders = [
        path for folder in traces.data_folders for path in sorted(folder.rglob("*")) if path.is_file() and _holds(path, MARKERS[what])
    ]
    assert not holders


@pytest.mark.parametrize("what", MARKERS)
def test_no_log_of_a_node_says(what: str, traces: Traces) -> None:
    assert not [path for path in traces.logs if _holds(path, MARKERS[what])]


@pytest.mark.parametrize("what", MARKERS)
def test_no_packet_carries(what: str, wire: Capture) -> None:
    assert not wire.found(MARKERS[what])


def _holds(path: Path, marker: bytes) -> bool:
    rest = b""
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            if marker in rest + chunk:
                return True
            rest = chunk[-len(marker) :]
    return False
