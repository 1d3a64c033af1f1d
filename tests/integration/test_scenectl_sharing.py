"""If this fails, a person cannot share a scene with another from the command line, or cannot end it."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from integration.scenectl_process import Done, command, environment, running, scenectl
from loopback import ports_option

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
"""Some thirty commands, each a process."""

RECORD_BYTES = 50_000
"""At the slowest rate a minute each, but for the first."""
LONG_ENOUGH_S = "50"
"""To look for former keys, however busy the machine is; a command that takes longer than a minute fails."""
ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")


@dataclass(frozen=True)
class People:
    """The profiles of those who work with one cluster."""

    owner: str
    ada: str
    ben: str


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> Iterator[People]:
    folder = tmp_path_factory.mktemp("trial")
    with running("node", "local", "3", "--folder", folder, "--ports", ports_option(*ADDRESSES), "--json") as (_, ready):
        profiles = {name: folder / name for name in ("ada", "ben")}
        for name, profile in profiles.items():
            invited = done("cluster", "invite", "--user", name, "--json", profile=ready["profile"])
            done("cluster", "join", invited.json["token"], profile=str(profile))
        done("scene", "create", "kitchen", profile=ready["profile"])
        yield People(ready["profile"], *map(str, profiles.values()))


def done(*arguments: str | Path, profile: str, stdin: bytes = b"") -> Done:
    found = scenectl(*arguments, profile=profile, stdin=stdin)
    assert found.code == 0, found.err
    return found


def put(profile: str, place: str, content: bytes) -> Done:
    return scenectl("data", "put", "files", place, "-", "--scene", "kitchen", profile=profile, stdin=content)


def get(profile: str, place: str) -> Done:
    return scenectl("data", "get", "files", place, "--scene", "kitchen", profile=profile)


def test_a_scene_is_shared_worked_in_and_taken_away_again(people: People) -> None:
    assert put(people.owner, "1", b"a plan").code == 0
    assert [scene["name"] for scene in done("scene", "list", "--json", profile=people.ada).json["scenes"]] == [None]
    get(people.ada, "1").refusal(1)

    access = done("scene", "grant", "kitchen", "user:ada", "--role", "writer", "--json", profile=people.owner).json
    assert [(member["name"], member["role"]) for member in access["members"]] == [("user:owner", "owner"), ("user:ada", "writer")]
    done("scene", "grant", "kitchen", "user:ben", profile=people.owner)
    assert [scene["name"] for scene in done("scene", "list", "--json", profile=people.ada).json["scenes"]] == ["kitchen"]
    assert get(people.ada, "1").out == get(people.ben, "1").out == b"a plan"
    assert put(people.ada, "2", b"ada's part").code == 0
    assert "reading only" in put(people.ben, "3", b"ben's part").refusal(1)
    assert "only an owner" in scenectl("scene", "grant", "kitchen", "user:ben", "--role", "writer", profile=people.ada).refusal(1)

    left = done("scene", "revoke", "kitchen", "user:ada", "--later", "--json", profile=people.owner).json
    assert (left["key_epoch"], len(left["members"]), left["sealed_anew"]) == (1, 2, None)
    assert "rotate-key kitchen --resume" in done("scene", "access", "kitchen", "--look", LONG_ENOUGH_S, profile=people.ben).out.decode()
    assert "was revoked" in put(people.ada, "4", b"late").refusal(4)
    assert put(people.owner, "5", b"after").code == 0
    assert "not sealed to you" in get(people.ada, "5").refusal(4)
    assert get(people.ben, "5").out == b"after" and get(people.ben, "2").out == b"ada's part"

    report = done("scene", "rotate-key", "kitchen", "--resume", "--json", profile=people.owner).json
    assert (report["key_epoch"], report["renewed"], report["unreadable"]) == (1, 2, 0)
    assert "not sealed to you" in get(people.ada, "1").refusal(4), "what lay there is under the new key by now"
    assert get(people.ben, "1").out == b"a plan"
    shown = done("scene", "access", "kitchen", "--look", LONG_ENOUGH_S, profile=people.ben).out.decode()
    assert "user:ben" in shown and "reader" in shown and "user:ada" not in shown and "--resume" not in shown

    again = done("scene", "rotate-key", "kitchen", "--rate", "50", "--json", profile=people.owner).json
    assert (again["key_epoch"], again["renewed"]) == (2, 3)
    assert get(people.ben, "1").out == b"a plan"


def test_a_revocation_seals_anew_what_lies_there_and_says_so_if_it_is_ended(people: People) -> None:
    def owner(*arguments: str, stdin: bytes = b"") -> Done:
        return done(*arguments, profile=people.owner, stdin=stdin)

    def left() -> list[str]:
        return [owner("scene", verb, "attic", "--look", LONG_ENOUGH_S, "--json").json["former_keys"] for verb in ("access", "info")]

    owner("scene", "create", "attic")
    owner("space", "create", "more", "--box", "0,0,0:1,1,1", "--scene", "attic")
    for space in ("files", "more"):
        owner("data", "put", space, "1", "-", "--scene", "attic", stdin=bytes(RECORD_BYTES))
    owner("scene", "grant", "attic", "user:ada", "--role", "writer")
    owner("scene", "grant", "attic", "user:ben")

    said = interrupted("scene", "revoke", "attic", "user:ada", "--rate", "0.001", profile=people.owner)
    assert "user:ada has no access to attic any more" in said and "`scenectl scene rotate-key attic --resume`" in said
    assert (
        "user:ada" not in (shown := owner("scene", "access", "attic", "--look", LONG_ENOUGH_S).out.decode())
        and "rotate-key attic --resume" in shown
    )
    assert (
        left() == ["some", "some"] and "rotate-key attic --resume" in owner("scene", "info", "attic", "--look", LONG_ENOUGH_S).out.decode()
    )
    assert owner("scene", "rotate-key", "attic", "--resume", "--json").json["complete"]
    assert left() == ["none", "none"]

    for more, to_renew in (((), 2), (("--later",), None)):
        planned = owner("scene", "revoke", "attic", "user:ben", "--dry-run", "--json", *more).json
        sealed = planned["sealed_anew"]
        assert ([member["name"] for member in planned["members"]], planned["key_epoch"], planned["dry_run"]) == (["user:owner"], 2, True)
        assert (sealed and sealed["to_renew"]) == to_renew
    words = owner("scene", "revoke", "attic", "user:ben", "--dry-run").out.decode()
    assert "user:ben would have no access to attic any more" in words and "2 of 2 records" in words and "Nothing is changed" in words
    assert "user:ben" in owner("scene", "access", "attic", "--look", "0.1").out.decode()

    report = owner("scene", "revoke", "attic", "user:ben", "--json").json["sealed_anew"]
    assert (report["key_epoch"], report["renewed"], report["complete"]) == (2, 2, True)
    assert left() == ["none", "none"]


def interrupted(*arguments: str, profile: str) -> str:
    """The error line of a command that is sent SIGINT once it says that it has begun what may be interrupted."""
    with subprocess.Popen(command(*arguments), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment(profile)) as process:
        assert process.stderr is not None
        assert b"may be interrupted" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        said = process.stderr.read().decode()
    return Done(process.returncode, b"", said).refusal(130)


def test_whom_the_cluster_does_not_know_nothing_is_granted(people: People) -> None:
    def refused(*arguments: str | Path) -> Done:
        return scenectl("scene", "grant", "kitchen", *arguments, profile=people.owner)

    refused("user:nobody").refusal(1)
    assert "names no member" in refused("ada").refusal(2)
    assert "there is no role" in refused("user:ben", "--role", "boss").refusal(2)
    own = Path(people.owner) / "users" / "owner" / "certificate.pem"
    assert "certificate of user:owner" in refused("user:ben", "--card", own).refusal(1)
    assert "cannot read" in refused("user:ben", "--card", "no/such/file").refusal(1)
    assert scenectl("scene", "rotate-key", "kitchen", "--rate", "0", profile=people.owner).code == 2


def test_no_key_stands_in_a_profile_in_the_clear(people: People) -> None:
    for profile in (people.owner, people.ben):
        entries = list((Path(profile) / "scenes").glob("*.toml"))
        assert entries
        for entry in entries:
            text = entry.read_text()
            assert "symmetric" not in text and "seed" not in text
            assert entry.stat().st_mode & 0o777 == 0o600
