"""If this fails, nobody can join a cluster by a token, or somebody joins who must not."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from integration.scenectl_process import LIMIT_S, children, running, scenectl
from loopback import ports_option
from scenefold.crypto import Token

FOUNDERS = ("127.0.0.2", "127.0.0.3")
NEWCOMER, LATER = "127.0.0.6", "127.0.0.7"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, dict[str, int]]]:
    """Two nodes: the profile of who made them, and their processes by address."""
    folder = tmp_path_factory.mktemp("trial")
    ports = ports_option(*FOUNDERS, NEWCOMER, LATER)
    with running("node", "local", "2", "--no-trust", "--folder", folder, "--ports", ports, "--json") as (process, ready):
        yield ready["profile"], children(process.pid)


@pytest.fixture
def profile(local: tuple[str, dict[str, int]]) -> str:
    return local[0]


def token_for(profile: str, *options: str) -> str:
    done = scenectl("cluster", "invite", *options, "--json", profile=profile)
    assert done.code == 0, done.err
    return str(done.json["token"])


def events(process: subprocess.Popen[bytes], name: str) -> Any:
    assert process.stdout is not None
    for line in process.stdout:
        found = json.loads(line)
        if found["event"] == name:
            return found
    assert process.stderr is not None
    raise AssertionError(f"it ended before it said {name!r}: {process.stderr.read().decode()[-3000:]}")


@contextmanager
def joining(token: str, profile: Path, data: Path, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    with running("cluster", "join", token, "--data", str(data), "--json", *options, profile=profile) as (process, first):
        assert first["event"] == "enrolled"
        yield process


def test_a_user_joins_by_a_token_and_works_with_scenes_of_its_own(profile: str, tmp_path: Path) -> None:
    token, mine = token_for(profile, "--user", "ada"), tmp_path / "mine"
    joined = scenectl("cluster", "join", token, "--json", profile=mine)
    assert joined.code == 0, joined.err
    assert joined.json == {"event": "enrolled", "cluster": "local", "name": "ada", "profile": str(mine)}
    assert scenectl("scene", "create", "attic", profile=mine).code == 0
    assert scenectl("data", "put", "files", "a1", "-", "--scene", "attic", profile=mine, stdin=b"mine").code == 0
    assert scenectl("data", "get", "files", "a1", "--scene", "attic", profile=mine).out == b"mine"
    # The two may share a scene by their names.
    assert scenectl("scene", "create", "hall", profile=profile).code == 0
    assert scenectl("data", "put", "files", "b1", "-", "--scene", "hall", profile=profile, stdin=b"ours").code == 0
    shared = scenectl("scene", "grant", "hall", "user:ada", "--role", "reader", profile=profile)
    assert shared.code == 0, shared.err
    read = scenectl("data", "get", "files", "b1", "--scene", "hall", profile=mine)
    assert read.out == b"ours", read.err
    users = scenectl("cluster", "users", "--json", profile=profile).json["users"]
    assert [(user["name"], user["admin"]) for user in users] == [("ada", False), ("owner", True)]
    used = scenectl("cluster", "join", token, profile=tmp_path / "other")
    assert used.code == 4 and "used already" in used.error
    forbidden = scenectl("cluster", "invite", "--user", "eve", profile=mine)
    assert forbidden.code == 4 and "no administrator" in forbidden.error
    assert not list(tmp_path.glob(".*.joining*")), "the keys lie in the profile only, and those of who was refused nowhere"


def test_a_node_joins_by_a_token_and_owns_a_part_of_the_line(profile: str, tmp_path: Path) -> None:
    token, mine = token_for(profile, "--node"), tmp_path / "node"
    with joining(token, mine, tmp_path / "data", "--address", NEWCOMER) as process:
        assert events(process, "member")["members"] == 3
        assert events(process, "arrived")["share"] > 0
        nodes = scenectl("cluster", "nodes", "--json", profile=profile).json["nodes"]
        assert NEWCOMER in [node["address"] for node in nodes]
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LIMIT_S)
    # From now on it is a node like any other.
    with running("node", "run", "--address", NEWCOMER, "--data", str(tmp_path / "data"), "--json", profile=mine) as (process, ready):
        assert ready["event"] == "ready"
        left = scenectl("node", "drain", NEWCOMER, "--json", profile=profile)
        assert left.code == 0, left.err
        process.communicate(timeout=LIMIT_S)


def test_an_address_that_this_machine_does_not_have_uses_up_no_token(profile: str, tmp_path: Path) -> None:
    token = token_for(profile, "--node")
    refused = scenectl("cluster", "join", token, "--address", "192.0.2.77", profile=tmp_path / "node")
    assert refused.code == 1 and "this machine does not have that address (192.0.2.77:" in refused.err
    assert not list(tmp_path.iterdir()), "nobody was asked"


def test_a_token_for_one_address_admits_no_other(profile: str, tmp_path: Path) -> None:
    token = token_for(profile, "--node", "--address", LATER)
    refused = scenectl("cluster", "join", token, "--address", NEWCOMER, profile=tmp_path / "node")
    assert refused.code == 4 and f"is for node:{LATER}" in refused.error


def test_invitations_are_listed_and_withdrawn(profile: str, tmp_path: Path) -> None:
    done = scenectl("cluster", "invite", "--user", "bob", "--admin", "--expires", "2d", "--json", profile=profile).json
    listed = {one["id"]: one for one in scenectl("cluster", "invitations", "--json", profile=profile).json["invitations"]}
    assert listed[done["id"]]["state"] == "open" and listed[done["id"]]["admin"] and listed[done["id"]]["by"] == "user:owner"
    assert scenectl("cluster", "invite", "--withdraw", done["id"], profile=profile).code == 0
    refused = scenectl("cluster", "join", done["token"], profile=tmp_path / "bob")
    assert refused.code == 4 and "withdrawn" in refused.error
    unknown = scenectl("cluster", "invite", "--withdraw", "00000000", profile=profile)
    assert unknown.code == 1 and "no open invitation has this id" in unknown.error


def test_who_lost_the_answer_asks_again_with_the_same_keys(profile: str, tmp_path: Path) -> None:
    token, mine = token_for(profile, "--user", "carl"), tmp_path / "mine"
    assert scenectl("cluster", "join", token, profile=mine).code == 0
    before = (mine / "users" / "carl" / "certificate.pem").read_bytes()
    # As if the process had ended between the answer and the last of the files.
    draft = mine.with_name(f".{mine.name}.joining-{Token.read(token).key.key_id:08x}")
    draft.mkdir(mode=0o700)
    for name in ("key.pem", "signing.seed", "sealing.seed"):
        shutil.copy2(mine / "users" / "carl" / name, draft / name)
    shutil.rmtree(mine)
    assert scenectl("cluster", "join", token, profile=mine).code == 0
    assert (mine / "users" / "carl" / "certificate.pem").read_bytes() == before


@pytest.mark.parametrize(
    "spoil, code, words",
    [
        (lambda token: token[:-3], 2, "not copied whole"),
        (lambda token: token.replace(token[20], "a" if token[20] != "a" else "b", 1), 2, "mistake"),
        (lambda token: "x" * 60, 2, "no token"),
    ],
)
def test_a_mistyped_token_is_told_so(profile: str, tmp_path: Path, spoil: Any, code: int, words: str) -> None:
    token = token_for(profile, "--user", f"user{time.monotonic_ns()}")
    done = scenectl("cluster", "join", spoil(token), profile=tmp_path / "mine")
    assert done.code == code and "token" in done.error, done.err


def test_a_revoked_user_is_shown_out_and_told_why(profile: str, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    assert scenectl("cluster", "join", token_for(profile, "--user", "dora"), profile=mine).code == 0
    with running("cluster", "top", "--json", profile=mine) as (process, first):
        assert all(node["alive"] for node in first["nodes"])
        assert scenectl("cluster", "revoke", "user:dora", profile=profile).code == 0
        assert process.stdout is not None
        # Its connections end, and no node answers it any more.
        for line in process.stdout:
            if not any(node["alive"] for node in json.loads(line)["nodes"]):
                break
    asked = scenectl("cluster", "users", profile=mine)
    assert asked.code == 4 and "the key of user:dora is revoked" in asked.error
    listed = scenectl("cluster", "users", "--json", profile=profile).json
    assert "user:dora" in listed["revoked"] and "dora" not in [user["name"] for user in listed["users"]]
    # The name may be given again; the old keys stay revoked.
    again = tmp_path / "again"
    assert scenectl("cluster", "join", token_for(profile, "--user", "dora"), profile=again).code == 0
    assert scenectl("cluster", "users", profile=again).code == 0
    assert scenectl("cluster", "users", profile=mine).code == 4
    last = scenectl("cluster", "revoke", "user:owner", profile=profile)
    assert last.code == 4 and "only administrator" in last.error


def test_a_revoked_node_leaves_at_once_and_its_address_may_come_back_under_new_keys(profile: str, tmp_path: Path) -> None:
    with joining(token_for(profile, "--node"), tmp_path / "node", tmp_path / "data", "--address", LATER, "--capacity", "4096") as process:
        events(process, "member")
        assert scenectl("cluster", "revoke", f"node:{LATER}", profile=profile).code == 0
        assert process.stderr is not None
        _, err = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 1 and b"the key of this node was revoked" in err
    assert LATER not in [node["address"] for node in scenectl("cluster", "nodes", "--json", profile=profile).json["nodes"]]
    started = scenectl("node", "run", "--address", LATER, "--data", str(tmp_path / "data"), "--seed-wait", "8", profile=tmp_path / "node")
    assert started.code != 0 and "revoked" in started.err
    token = token_for(profile, "--address", LATER)
    with joining(token, tmp_path / "again", tmp_path / "fresh", "--address", LATER, "--capacity", "4096") as process:
        assert events(process, "member")["members"] == 3
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LIMIT_S)


def test_a_trusted_node_enrols_without_the_one_that_was_trusted_first(
    profile: str, local: tuple[str, dict[str, int]], tmp_path: Path
) -> None:
    # Who administers need not have the authority's key: then a trusted node seals it to the next one.
    office = Path(shutil.copytree(profile, tmp_path / "office"))
    (office / "authority" / "key.pem").unlink()
    trusted = scenectl("cluster", "trust", FOUNDERS[1], profile=office)
    assert trusted.code == 0, trusted.err
    roles = {node["address"]: node["trusted"] for node in scenectl("cluster", "nodes", "--json", profile=profile).json["nodes"]}
    assert roles[FOUNDERS[0]] and roles[FOUNDERS[1]]
    assert "voter, trusted" in scenectl("cluster", "status", profile=profile).out.decode()
    # From now on the first one may lose its trust, and the key that was sealed to it serves for nothing.
    withdrawn = scenectl("cluster", "trust", FOUNDERS[0], "--withdraw", profile=profile)
    assert withdrawn.code == 0, withdrawn.err
    assert f"scene relieve {FOUNDERS[0]}" in withdrawn.out.decode(), "it decides scenes all the same"
    assert scenectl("cluster", "join", token_for(profile, "--user", "fred"), profile=tmp_path / "fred").code == 0
    last = scenectl("cluster", "trust", FOUNDERS[1], "--withdraw", profile=profile)
    assert last.code == 4 and "only trusted node" in last.error
    assert scenectl("cluster", "trust", FOUNDERS[0], profile=profile).code == 0
    storing = scenectl("cluster", "trust", "127.0.0.99", profile=profile)
    assert storing.code == 1 and "no node of this cluster" in storing.error


def test_a_token_that_names_no_node_finds_the_cluster_by_broadcast(profile: str, tmp_path: Path) -> None:
    token = token_for(profile, "--user", "gwen", "--find")
    assert Token.read(token).addresses == ()
    joined = scenectl("cluster", "join", token, profile=tmp_path / "gwen")
    assert joined.code == 0, joined.err
    withdrawn = scenectl("cluster", "invite", "--user", "hans", "--find", "--json", profile=profile).json
    assert scenectl("cluster", "invite", "--withdraw", withdrawn["id"], profile=profile).code == 0
    alone = scenectl("cluster", "join", withdrawn["token"], profile=tmp_path / "hans")
    assert alone.code == 3 and "no node of the cluster answers on the local network" in alone.error
