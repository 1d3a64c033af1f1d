"""If this fails, a cluster of which any node may be away cannot be reached, or gone back to, while the one with which it began is."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest

from integration.scenectl_process import await_ends, children, running, scenectl
from integration.test_enrolling import events, joining, token_for
from loopback import ports_option

FIRST, *JOINED = ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4", "127.0.0.5")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


class Studio(NamedTuple):
    """The profile of who made it, that of a user who joined by a token, and the last node, with its process."""

    owner: str
    ada: Path
    last: Path
    process: subprocess.Popen[bytes]


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    """One node, and three that joined; two of them decide with the first, which was killed since."""
    folder = tmp_path_factory.mktemp("studio")
    with ExitStack() as nodes:
        local = ("node", "local", "1", "--folder", folder, "--ports", ports_option(*ADDRESSES), "--json")
        process, ready = nodes.enter_context(running(*local))
        owner = ready["profile"]
        for address in JOINED:
            at = joining(token_for(owner, "--node"), folder / address, folder / f"{address}-data", "--address", address)
            events(last := nodes.enter_context(at), "arrived")
        for order in (("trust", "--all"), ("add-voter", JOINED[0]), ("add-voter", JOINED[1])):
            done = scenectl("cluster", *order, profile=owner)
            assert done.code == 0, done.err
        assert scenectl("scene", "create", "hall", "--copies", "2", profile=owner).code == 0
        put = scenectl("data", "put", "files", "f1", "-", "--scene", "hall", profile=owner, stdin=b"before")
        assert put.code == 0, put.err
        ada = folder / "ada"
        assert scenectl("cluster", "join", token_for(owner, "--user", "ada"), profile=ada).code == 0
        first = children(process.pid)[FIRST]
        os.kill(first, signal.SIGKILL)
        await_ends([first])
        yield Studio(owner, ada, folder / JOINED[-1], last)


PROFILES: tuple[Callable[[Studio], str | Path], ...] = (lambda studio: studio.owner, lambda studio: studio.ada)


@pytest.mark.parametrize("whose", PROFILES, ids=("owner", "ada"))
def test_whoever_asks_is_answered_by_the_others(studio: Studio, whose: Callable[[Studio], str | Path]) -> None:
    status = scenectl("cluster", "status", "--json", profile=whose(studio))
    assert status.code == 5, status.err
    assert {node["address"]: node["alive"] for node in status.json["nodes"]}[JOINED[0]]
    listed = scenectl("scene", "list", "--json", profile=whose(studio))
    assert listed.code == 0, listed.err
    assert scenectl("cluster", "invitations", profile=whose(studio)).code == 0


@pytest.mark.long
def test_what_a_scene_consists_of_is_read_and_decided(studio: Studio) -> None:
    decided = scenectl("scene", "participants", "hall", "--json", profile=studio.owner)
    assert decided.code == 0, decided.err
    assert FIRST in str(decided.json)
    got = scenectl("data", "get", "files", "f1", "--scene", "hall", profile=studio.owner)
    assert got.out == b"before", got.err
    # Whose place is whose, chance has decided: where the first node is a holder, it is named, and nothing else is in the way.
    puts = {place: put_at(studio, place) for place in ("1", "5", "9", "d")}
    assert all(FIRST in why for why in puts.values() if why), puts


def put_at(studio: Studio, place: str) -> str:
    """Why a record is not stored there."""
    put = scenectl("data", "put", "files", place, "-", "--scene", "hall", profile=studio.owner, stdin=b"after")
    return "" if put.code == 0 else put.err


def test_a_node_that_joined_comes_back_though_its_seed_is_away(studio: Studio) -> None:
    studio.process.kill()
    studio.process.communicate()
    data = studio.last.with_name(f"{JOINED[-1]}-data")
    at = ("node", "run", "--address", JOINED[-1], "--data", str(data), "--seed-wait", "8", "--json")
    with running(*at, profile=studio.last) as (process, ready):
        assert ready["event"] == "ready"
        nodes = scenectl("cluster", "nodes", "--json", profile=studio.owner)
        assert JOINED[-1] in [node["address"] for node in nodes.json["nodes"]]
        assert process.poll() is None


def test_a_newcomer_is_sent_to_others_as_well(studio: Studio) -> None:
    bob = studio.ada.with_name("bob")
    joined = scenectl("cluster", "join", token_for(studio.owner, "--user", "bob"), profile=bob)
    assert joined.code == 0, joined.err
    assert scenectl("scene", "list", profile=bob).code == 0
