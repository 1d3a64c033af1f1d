"""If this fails, scenectl cannot make a cluster, run its nodes, or keep data in it, as its users would."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from integration.scenectl_process import running, scenectl
from loopback import ports_option
from scenefold.world.profile import ClusterProfile

ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Three nodes, as `node local` runs them."""
    folder = tmp_path_factory.mktemp("trial")
    with running("node", "local", "3", "--folder", folder, "--ports", ports_option(*ADDRESSES), "--json") as (_, ready):
        assert ready["event"] == "ready"
        assert tuple(ready["nodes"]) == ADDRESSES
        yield ready["profile"]


@pytest.fixture(scope="module")
def scene(profile: str) -> str:
    done = scenectl("scene", "create", "kitchen", "--json", profile=profile)
    assert done.code == 0, done.err
    assert done.json["name"] == "kitchen"
    return "kitchen"


def test_status_shows_all_nodes(profile: str) -> None:
    done = scenectl("cluster", "status", "--json", profile=profile)
    assert done.code == 0, done.err
    assert [node["address"] for node in done.json["nodes"]] == list(ADDRESSES)
    assert sum(node["share"] for node in done.json["nodes"]) == pytest.approx(1)
    assert not done.json["degraded"]


def test_scenes_are_listed_and_made_once(profile: str, scene: str) -> None:
    listed = scenectl("scene", "list", "--json", profile=profile).json["scenes"]
    assert [(entry["name"], entry["has_key"]) for entry in listed if entry["name"] == scene] == [(scene, True)]
    again = scenectl("scene", "create", scene, profile=profile)
    assert again.code == 1
    assert "exists already" in again.error
    info = scenectl("scene", "info", scene, "--json", profile=profile)
    assert info.json["name"] == scene


def test_records_come_back_and_are_listed(profile: str, scene: str, tmp_path: Path) -> None:
    at = ["--scene", scene]
    for place in ("0a", "5f", "ff"):
        done = scenectl("data", "put", "files", place, "-", *at, profile=profile, stdin=f"at {place}".encode())
        assert done.code == 0, done.err
    assert scenectl("data", "get", "files", "5f", *at, profile=profile).out == b"at 5f"
    got = scenectl("data", "get", "10", "ff", "-o", tmp_path / "got", *at, "--json", profile=profile)
    assert (tmp_path / "got").read_bytes() == b"at ff"
    assert got.json["bytes"] == 5
    listed = scenectl("data", "ls", "files", *at, "--json", profile=profile).json
    assert [location[:2] for location in listed["locations"]] == ["0a", "5f", "ff"]
    part = scenectl("data", "ls", "files", *at, "--first", "0b", "--last", "5", profile=profile)
    assert part.out.decode().split() == ["5f".ljust(40, "0")]
    cut = scenectl("data", "ls", "files", *at, "--limit", "1", "--json", profile=profile).json
    assert cut["more"]


def test_a_deleted_record_is_gone_and_its_place_is_free(profile: str, scene: str) -> None:
    at = ["--scene", scene]
    assert scenectl("data", "put", "meta", "33", "-", *at, profile=profile, stdin=b"first").code == 0
    assert scenectl("data", "delete", "meta", "33", *at, "--json", profile=profile).json["location"] == "33".ljust(40, "0")
    listings = [["data", "ls", "meta", "--first", "33", "--last", "33", *at, "--json", *more] for more in ([], ["--deleted"])]
    assert [len(scenectl(*listing, profile=profile).json["locations"]) for listing in listings] == [0, 1]
    for verb in ("get", "delete"):
        gone = scenectl("data", verb, "meta", "33", *at, profile=profile)
        assert gone.code == 1 and "no record" in gone.error
    assert scenectl("data", "put", "meta", "33", "-", *at, "--new", profile=profile, stdin=b"second").code == 0
    assert scenectl("data", "get", "meta", "33", *at, profile=profile).out == b"second"


def test_data_errors(profile: str, scene: str, tmp_path: Path) -> None:
    at = ["--scene", scene]
    missing = scenectl("data", "get", "meta", "77", *at, "--json", profile=profile)
    assert missing.code == 1
    assert "no record" in missing.error
    assert missing.json["exit_code"] == 1
    big = scenectl("data", "put", "files", "01", "-", *at, profile=profile, stdin=bytes(61_441))
    assert big.code == 1
    assert "does not fit" in big.error
    scenectl("data", "put", "files", "02", "-", *at, profile=profile, stdin=b"first")
    second = scenectl("data", "put", "files", "02", "-", *at, "--new", profile=profile, stdin=b"second")
    assert second.code == 4
    assert "already" in second.error
    assert scenectl("data", "get", "files", "02", *at, profile=profile).out == b"first"
    nowhere = scenectl("data", "get", "files", "02", "-o", tmp_path / "nowhere" / "f", *at, profile=profile)
    assert "choose another file" in nowhere.refusal(1) and str(tmp_path / "nowhere" / "f") in nowhere.error
    spaceless = scenectl("data", "put", "4711", "02", "-", *at, profile=profile, stdin=b"x")
    assert "unknown scene or space" in spaceless.refusal(1) and "scenectl space list" in spaceless.error
    unknown = scenectl("data", "get", "files", "02", "--scene", "attic", profile=profile)
    assert unknown.code == 1
    assert "attic" in unknown.error


def test_a_file_is_imported_again_without_growth(profile: str, tmp_path: Path) -> None:
    (tmp_path / "square.obj").write_text(SQUARE)
    first = scenectl("scene", "import", tmp_path / "square.obj", "--json", profile=profile)
    assert first.code == 0, first.err
    info = scenectl("scene", "info", "square", "--json", profile=profile).json
    assert info["counts"]["triangles"] == 2
    assert info["content_sha256"] == first.json["content_sha256"]
    again = scenectl("scene", "import", tmp_path / "square.obj", "--json", profile=profile).json
    assert again["reused"] == again["records"] - 1


def test_a_bad_file_makes_no_scene(profile: str, tmp_path: Path) -> None:
    (tmp_path / "broken.glb").write_bytes(b"glTF but not really")
    done = scenectl("scene", "import", tmp_path / "broken.glb", profile=profile)
    assert done.code == 1
    assert "broken.glb" in done.error
    assert "broken" not in scenectl("scene", "list", profile=profile).out.decode()


def test_a_cluster_of_its_own_nodes_one_missing(tmp_path: Path) -> None:
    addresses = ("127.0.0.12", "127.0.0.13")
    made = scenectl("cluster", "init", tmp_path / "studio", "--nodes", ",".join(addresses), "--ports", ports_option(*addresses), "--json")
    assert made.code == 0, made.err
    assert made.json["name"] == "studio"
    profile = tmp_path / "studio"
    again = scenectl("cluster", "init", profile, "--nodes", "127.0.0.2")
    assert again.code == 1
    assert "exists already" in again.error
    alone = scenectl("cluster", "status", "--json", profile=profile)
    assert alone.code == 3
    assert alone.json["error"]["kind"] == "unreachable"
    with running("node", "run", "--address", addresses[0], "--data", tmp_path / "data", "--json", profile=profile) as (process, ready):
        assert ready["address"] == addresses[0]
        status = scenectl("cluster", "status", "--json", profile=profile)
        assert status.code == 5
        assert [node["alive"] for node in status.json["nodes"]] == [True, False]
        taken = scenectl("node", "run", "--address", addresses[0], "--data", tmp_path / "other", profile=profile)
        assert taken.code == 1
        assert "port" in taken.error
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=90)
        assert process.returncode == 0
    foreign = scenectl("node", "run", "--address", addresses[1], "--data", tmp_path / "data", profile=profile)
    assert foreign.code == 1
    assert addresses[0] in foreign.error or "another node" in foreign.error


@pytest.mark.parametrize("verb", [["cluster", "status"], ["scene", "list"]])
def test_a_profile_of_another_cluster_is_told_from_nodes_that_are_away(profile: str, verb: list[str], tmp_path: Path) -> None:
    ports = ClusterProfile.load(Path(profile)).ports
    for away in ("127.0.0.1", "127.0.0.14"):
        other = tmp_path / away
        nodes = ",".join([away, *ADDRESSES])
        assert scenectl("cluster", "init", other, "--nodes", nodes, "--ports", f"{ports.low},{ports.high}").code == 0
        assert "its certificate is not valid here" in scenectl(*verb, profile=other).refusal(3)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_ctrl_c_and_a_closed_terminal_leave_nothing_behind(number: signal.Signals, tmp_path: Path) -> None:
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip(f"{number.name} is ignored here, as under nohup, and children inherit that")
    ports = ports_option("127.0.0.2")
    with running("node", "local", "1", "--ports", ports, "--json", TMPDIR=str(tmp_path)) as (process, _):
        assert list(tmp_path.iterdir())
        process.send_signal(number)
        _, err = process.communicate(timeout=90)
        assert process.returncode == 130
        assert b"Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_without_a_profile_there_is_a_clear_error(tmp_path: Path) -> None:
    done = scenectl("scene", "list", XDG_CONFIG_HOME=str(tmp_path))
    assert done.code == 1
    assert "cluster init" in done.error
    named = scenectl("scene", "list", "--profile", "nowhere", XDG_CONFIG_HOME=str(tmp_path))
    assert named.code == 1
    assert "nowhere" in named.error
