"""If this fails, nodes cannot join or leave by the command line, or it does not say how the cluster does while they do."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from integration.scenectl_process import LIMIT_S, children, running, scenectl
from loopback import ports_option

FOUNDERS = ("127.0.0.2", "127.0.0.3")
SPARES = ("127.0.0.4", "127.0.0.5")
PLACES = [f"{digit:x}1" for digit in range(16)]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, dict[str, int]]]:
    """Two nodes with some records: the profile, and their processes by address."""
    folder = tmp_path_factory.mktemp("trial")
    ports = ports_option(*FOUNDERS, *SPARES)
    with running("node", "local", "2", "--spares", "2", "--folder", folder, "--ports", ports, "--json") as (process, ready):
        found = ready["profile"]
        assert ready["spares"] == list(SPARES)
        assert scenectl("scene", "create", "kitchen", profile=found).code == 0
        for place in PLACES:
            done = scenectl("data", "put", "files", place, "-", "--scene", "kitchen", profile=found, stdin=place.encode() * 100)
            assert done.code == 0, done.err
        yield found, children(process.pid)


@pytest.fixture
def profile(local: tuple[str, dict[str, int]]) -> str:
    return local[0]


def check_readable(profile: str) -> None:
    listed = scenectl("data", "ls", "files", "--scene", "kitchen", "--json", profile=profile).json
    assert [location[:2] for location in listed["locations"]] == PLACES
    for place in PLACES[::5]:
        assert scenectl("data", "get", "files", place, "--scene", "kitchen", profile=profile).out == place.encode() * 100


@contextmanager
def hanging(pid: int) -> Iterator[None]:
    """A node hangs: it takes what is sent, and answers nothing."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


@contextmanager
def joining(profile: str, address: str, data: Path, *options: str, named: bool = True) -> Iterator[subprocess.Popen[bytes]]:
    """A node that joins; `named`: its address is said, and not found out."""
    who = ["--address", address] if named else []
    arguments = ["cluster", "join", FOUNDERS[0], *who, "--data", str(data), "--json", *options]
    with running(*arguments, profile=profile) as (process, ready):
        assert ready == {"event": "ready", "address": address, "data": str(data)}
        yield process


def event(process: subprocess.Popen[bytes], name: str) -> Any:
    """The next event of this name."""
    assert process.stdout is not None
    for line in process.stdout:
        found = json.loads(line)
        if found["event"] == name:
            return found
    raise AssertionError(f"it ended before it said {name!r}")


def test_a_spare_joins_is_listed_and_leaves(profile: str, tmp_path: Path) -> None:
    spare = SPARES[0]
    # What its machine is given: of all nodes' keys, its own.
    machine = Path(shutil.copytree(profile, tmp_path / "machine"))
    for other in (*FOUNDERS, SPARES[1]):
        shutil.rmtree(machine / "nodes" / other)
    with joining(str(machine), spare, tmp_path / "data", "--place", "c0", named=False) as process:
        member = event(process, "member")
        assert member["members"] == 3 and {member["left"], member["right"]} == set(FOUNDERS)
        arrived = event(process, "arrived")
        assert arrived["records"] > 0 and arrived["share"] > 0.2
        listed = scenectl("cluster", "nodes", "--json", profile=profile).json["nodes"]
        assert [node["address"] for node in listed] == [FOUNDERS[0], spare, FOUNDERS[1]]
        assert [node["role"] for node in listed] == ["voter", "member", "member"]
        assert sum(node["share"] for node in listed) == pytest.approx(1)
        assert sum(node["records"] for node in listed) >= len(PLACES)
        assert all(node["heard_s"] < 60 and node["lease_s"] > 0 and len(node["incarnation"]) == 32 for node in listed)
        status = scenectl("cluster", "status", profile=profile)
        assert status.code == 0, status.out
        assert f"{len(listed)} of 3 nodes alive" in status.out.decode()
        check_readable(profile)
        busy = scenectl("node", "drain", spare, "--check", "--json", profile=profile)
        assert busy.code == 5 and not busy.json["may_switch_off"]
        assert "owns a part of the line" in busy.json["obstacles"][0]
        planned = scenectl("node", "drain", spare, "--dry-run", "--json", profile=profile)
        assert planned.code == 0 and planned.json["state"] == "serving" and planned.json["room_bytes"] >= planned.json["bytes"] > 0
        left = scenectl("node", "drain", spare, "--json", profile=profile)
        assert left.code == 0, left.err
        assert left.json["state"] == "left" and left.json["may_switch_off"]
        assert event(process, "left")["address"] == spare
        assert process.wait(LIMIT_S) == 0
    check_readable(profile)
    assert [node["address"] for node in scenectl("cluster", "nodes", "--json", profile=profile).json["nodes"]] == list(FOUNDERS)
    (gone,) = scenectl("cluster", "nodes", "--removed", "--json", profile=profile).json["removed"]
    assert (gone["address"], gone["by"], gone["reason"], gone["is_back"]) == (spare, spare, "drained", False)
    status = scenectl("cluster", "status", profile=profile)
    assert status.code == 0 and f"{spare} is no member any more: drained" in status.out.decode()


def test_a_newcomer_without_room_gets_nothing_and_is_seen_to_wait(profile: str, tmp_path: Path) -> None:
    spare = SPARES[1]
    with joining(profile, spare, tmp_path / "data", "--capacity", "4096") as process:
        event(process, "member")
        # Whoever is asked may hear of the newcomer a moment after it does itself.
        for _ in range(10):
            status = scenectl("cluster", "status", "--json", profile=profile)
            listed = [node for node in status.json["nodes"] if node["address"] == spare]
            if listed:
                break
        (waiting,) = listed
        assert waiting["role"] == "joining" and waiting["arc"] is None and waiting["share"] == 0
        assert "joining" in [warning["kind"] for warning in status.json["warnings"] if warning["address"] == spare]
        check_readable(profile)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0
    away = scenectl("cluster", "status", profile=profile)
    assert away.code == 5
    assert f"warning: {spare} does not answer" in away.out.decode()
    silent = scenectl("node", "drain", spare, profile=profile)
    assert silent.code == 3 and spare in silent.error


def test_a_node_that_is_a_member_already_is_ready_first(profile: str, tmp_path: Path) -> None:
    for _ in range(2):
        with joining(profile, SPARES[1], tmp_path / "data", "--capacity", "4096") as process:
            assert event(process, "member")["members"] == 3
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=LIMIT_S)


def test_a_blacklist_is_changed_while_its_node_runs_and_everybody_hears_of_it(profile: str) -> None:
    def blacklist(verb: str, *arguments: str, code: int = 0) -> Any:
        done = scenectl("node", "blacklist", verb, *arguments, "--json", profile=profile)
        assert done.code == code, done.err
        return done.json

    owner, other = FOUNDERS
    before = blacklist("list", owner)
    assert blacklist("list", "--node", owner) == before
    assert before == {"address": owner, "version": before["version"], "blacklist": []}
    planned = blacklist("add", "10.1.2.0/24", other, "--node", owner, "--dry-run")
    # Spares may have come and stayed.
    members = [node["address"] for node in scenectl("cluster", "nodes", "--json", profile=profile).json["nodes"]]
    allowed = [address for address in members if address not in FOUNDERS]
    wanted = {"address": owner, "dry_run": True, "blacklist": ["10.1.2.0/24", other], "forbidden": [other], "allowed": allowed}
    assert planned == wanted and blacklist("list", owner) == before, "nothing was changed"
    text = scenectl("node", "blacklist", "add", other, "--node", owner, "--dry-run", profile=profile).out.decode()
    assert f"could lie on {', '.join(allowed) or 'no other node'}, and not on {other}." in text
    number = len(allowed) + 1
    assert f"So there could be {number} {'copies' if number > 1 else 'copy'} of each record at most" in text
    added = blacklist("add", "10.1.2.0/24", other, "--node", owner)
    left = {"forbidden": [other], "allowed": allowed}
    listed = {"address": owner, "version": before["version"] + 1, "blacklist": ["10.1.2.0/24", other]}
    assert added == {**listed, **left}
    assert blacklist("add", other, "--node", owner) == added
    assert blacklist("list", owner) == listed
    # A test before this one may have left a member that is silent, until that is removed.
    done = scenectl("node", "blacklist", "list", "--json", profile=profile)
    of_all = {node["address"]: node for node in done.json["nodes"]}
    assert done.code == (0 if all(node["answers"] for node in of_all.values()) else 5)
    assert of_all.pop(owner) == {**listed, "answers": True}
    assert of_all[other]["answers"] and not any(node["blacklist"] for node in of_all.values())
    text = scenectl("node", "blacklist", "list", profile=profile).out.decode()
    assert f"Node {owner}: no copies of its data on 10.1.2.0/24, {other}.\n" in text and len(text.splitlines()) >= 1 + len(of_all)
    text = scenectl("node", "blacklist", "add", other, "--node", owner, profile=profile).out.decode()
    assert f"there can be {number} {'copies' if number > 1 else 'copy'} of each record at most" in text.lower()
    (shown,) = [node for node in scenectl("cluster", "status", "--json", profile=profile).json["nodes"] if node["address"] == owner]
    assert (shown["blacklist"], shown["blacklist_version"]) == (added["blacklist"], added["version"])
    text = scenectl("cluster", "status", profile=profile).out.decode()
    assert f"{owner} wants no copies of its data on 10.1.2.0/24, {other}" in text
    for arguments, words in (
        (("rm", "10.1.2.0/25", "--node", owner), f"10.1.2.0/25: not on the blacklist of {owner}"),
        (("add", owner, "--node", owner), f"{owner} is the node's own address, which is on its blacklist always"),
        (("add", *(f"10.0.0.{number}" for number in range(1, 32)), "--node", owner), "a blacklist of 33 entries, where 32 are allowed"),
        (("rm", "10.1.2.0/25", "--node", owner, "--dry-run"), f"10.1.2.0/25: not on the blacklist of {owner}"),
        (("list", "127.0.0.99"), "no node of this address is a member"),
    ):
        assert words in blacklist(*arguments, code=1)["error"]["what"]
    done = scenectl("node", "blacklist", "rm", "10.1.2.0/24", other, "--node", owner, profile=profile)
    assert done.out.decode().strip() == f"Node {owner}: every other node may hold copies of its data."
    assert blacklist("list", owner) == {"address": owner, "version": added["version"] + 1, "blacklist": []}


def test_what_nodes_do_by_themselves_is_paused_slowed_and_resumed_while_nodes_run(profile: str) -> None:
    def upkeep(verb: str, *arguments: str, code: int = 0) -> Any:
        done = scenectl("node", "upkeep", verb, *arguments, "--json", profile=profile)
        assert done.code == code, done.err
        return {node.pop("address"): node for node in done.json["nodes"]} if "nodes" in done.json else done.json

    owner, other = FOUNDERS
    before = upkeep("show", *FOUNDERS)
    assert set(before) == set(FOUNDERS) and not any(node["paused"] for node in before.values())
    assert upkeep("pause", owner, "--repair") == {owner: {**before[owner], "paused": ["repair"]}}
    assert upkeep("pause", *FOUNDERS)[other]["paused"] == ["repair", "scrub", "balance"]
    # Others may have come and gone.
    silent = [node["address"] for node in scenectl("cluster", "health", "--json", profile=profile).json["nodes"] if not node["alive"]]
    told = upkeep("show", code=5 if silent else 0)
    assert [address for address, node in told.items() if not node["answers"]] == silent
    assert all(told[founder]["paused"] == ["repair", "scrub", "balance"] for founder in FOUNDERS)
    assert f"{owner}: repair, scrub and balance paused" in scenectl("cluster", "health", profile=profile).out.decode()
    assert upkeep("resume", owner, "--scrub", "--balance")[owner]["paused"] == ["repair"]
    upkeep("resume", *FOUNDERS)
    slow = upkeep("rate", owner, "--transfer", "1000000", "--scrub", "50000")[owner]
    assert (slow["transfer_bytes_per_s"], slow["scrub_bytes_per_s"]) == (1_000_000, 50_000)
    upkeep("rate", owner, "--transfer", "0", "--scrub", "0")
    assert upkeep("show", *FOUNDERS) == before
    assert "no node of this address is a member" in upkeep("pause", "127.0.0.99", code=1)["error"]["what"]
    assert "nothing to change" in upkeep("rate", owner, code=2)["error"]["what"]


def test_the_node_that_decides_cannot_be_drained(profile: str) -> None:
    planned = scenectl("node", "drain", FOUNDERS[0], "--dry-run", profile=profile)
    assert planned.code == 5 and "would refuse" in planned.out.decode()
    refused = scenectl("node", "drain", FOUNDERS[0], profile=profile)
    assert refused.code == 4 and "cannot do without it" in refused.error and FOUNDERS[0] in refused.error
    assert f"add-voter ADDRESS; then scenectl cluster remove-voter {FOUNDERS[0]}" in refused.error
    last = scenectl("cluster", "remove-voter", FOUNDERS[0], profile=profile)
    assert last.code == 4 and "the last voter stays" in last.error and "cluster add-voter ADDRESS" in last.error
    check = scenectl("node", "drain", FOUNDERS[0], "--check", "--json", profile=profile)
    assert check.code == 5 and check.json["state"] == "serving"


def test_top_compares_two_looks(profile: str) -> None:
    once = scenectl("cluster", "top", "--once", "--json", profile=profile)
    assert once.code == 0, once.err
    nodes = [node for node in once.json["nodes"] if node["alive"]]
    assert [node["address"] for node in nodes] == list(FOUNDERS)
    assert all(isinstance(node["records_per_second"], float) and node["rays_per_second"] == 0 for node in nodes)
    assert 0.9 < once.json["seconds"] < 30 and once.json["handovers"] == []
    with running("cluster", "top", "--json", profile=profile) as (process, first):
        assert first["name"] == once.json["name"]
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0 and err == b""


def test_a_node_that_hangs_holds_up_nobody_in_top(local: tuple[str, dict[str, int]]) -> None:
    profile, pids = local
    with running("cluster", "top", "--json", profile=profile) as (process, first):
        silent = FOUNDERS[1]
        assert process.stdout is not None and first["nodes"]
        with hanging(pids[silent]):
            for line in process.stdout:
                found = {node["address"]: node for node in json.loads(line)["nodes"]}
                if not found[silent]["alive"] and found[silent]["said_s"] > 2:
                    break
        assert found[FOUNDERS[0]]["said_s"] == 0 and found[silent]["records"] > 0
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT_S)


def test_a_newcomer_says_that_it_waits_for_the_voter(local: tuple[str, dict[str, int]], tmp_path: Path) -> None:
    profile, pids = local
    arguments = ["cluster", "join", FOUNDERS[1], "--address", SPARES[1], "--data", str(tmp_path / "data"), "--json"]
    with hanging(pids[FOUNDERS[0]]), running(*arguments, profile=profile) as (process, _):
        while "voter" not in (text := event(process, "waiting")["text"]):
            assert "tells who its members are" in text
        assert FOUNDERS[0] in text
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LIMIT_S)


@pytest.mark.parametrize(
    "arguments, code, words",
    [
        (["cluster", "join", FOUNDERS[0], "--address", FOUNDERS[0]], 2, "through itself"),
        (["cluster", "join", FOUNDERS[0]], 2, f"choose with --address, of {', '.join(SPARES)}"),
        (["cluster", "join", "kitchen", "--address", SPARES[0]], 2, "nor an IPv4 address"),
        (["cluster", "join", FOUNDERS[0], "--address", "127.0.0.99"], 1, "no node of this cluster"),
        (["cluster", "join", FOUNDERS[0], "--address", SPARES[0], "--place", "middle"], 2, "no place on the line"),
        (["node", "drain", "127.0.0.99"], 1, "no node of this address is a member"),
        (["node", "drain", FOUNDERS[1], "--check", "--cancel"], 2, "exclude each other"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(profile: str, arguments: list[str], code: int, words: str, tmp_path: Path) -> None:
    more = ["--data", str(tmp_path)] if arguments[0] == "cluster" else []
    done = scenectl(*arguments, *more, profile=profile)
    assert done.code == code, done.err
    assert words in done.error
