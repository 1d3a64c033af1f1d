"""If this fails, scenectl makes spaces that nobody finds, moves them wrongly, or shows records where they are not."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from integration.scenectl_process import Done, running, scenectl
from loopback import ports_option

ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")
CUBE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Three nodes with one scene."""
    folder = tmp_path_factory.mktemp("trial")
    with running("node", "local", "3", "--folder", folder, "--ports", ports_option(*ADDRESSES), "--json") as (_, ready):
        done = scenectl("scene", "create", "kitchen", profile=ready["profile"])
        assert done.code == 0, done.err
        yield ready["profile"]


def space(profile: str, *arguments: str) -> Done:
    return scenectl("space", *arguments, "--scene", "kitchen", "--json", profile=profile)


def made(profile: str, name: str, *arguments: str) -> int:
    done = space(profile, "create", name, *arguments)
    assert done.code == 0, done.err
    number: int = done.json["space"]
    return number


def put(profile: str, number: int, *digits: str) -> None:
    for place in digits:
        done = scenectl("data", "put", str(number), place, "-", "--scene", "kitchen", profile=profile, stdin=place.encode())
        assert done.code == 0, done.err


def found(profile: str, name: str, box: str) -> list[str]:
    done = space(profile, "query", name, "--box", box)
    assert done.code == 0, done.err
    return [record["location"][:1] for record in done.json["records"]]


def test_a_space_is_made_moved_scaled_and_asked(profile: str) -> None:
    number = made(profile, "strip", "--box", "0:16", "--curve", "z-order")
    put(profile, number, "0", "4", "8", "f")
    assert found(profile, "strip", "0:5") == ["0", "4"], "the first digit is the place in the strip"
    moved = space(profile, "translate", "strip", "--by", "-8")
    assert (moved.json["world_low"], moved.json["world_high"]) == ([-8], [8])
    assert found(profile, "strip", "-5:1") == ["4", "8"]
    scaled = space(profile, "scale", str(number), "--by", "0.5")
    assert (scaled.json["factor"], scaled.json["offset"]) == (0.5, [-4])
    asked = space(profile, "query", "strip", "--box", "3.4:3.6").json
    assert [record["position"] for record in asked["records"]] == [[pytest.approx(3.5)]]
    everything = space(profile, "query", "strip", "--limit", "2").json
    assert (len(everything["records"]), everything["more"]) == (2, True)
    assert scenectl("data", "get", str(number), "8", "--scene", "kitchen", profile=profile).out == b"8"


def test_a_change_that_is_repeated_under_its_request_is_made_once(profile: str) -> None:
    made(profile, "ledge", "--box", "0:16")
    move = ("translate", "ledge", "--by", "2")
    assert space(profile, *move).json["offset"] == [2]
    told = scenectl("scene", "log", "kitchen", "--last", "1", "--json", profile=profile).json["entries"][0]
    request = f"{told['request']}@{told['position']}"
    assert space(profile, *move, "--request", request).json["offset"] == [2], "as if it had been made now"
    assert f"another change, which is in the log at position {told['position']}" in space(
        profile, "translate", "ledge", "--by", "3", "--request", request
    ).refusal(1)
    never = f"{'0f' * 16}@{told['position']}"
    assert [space(profile, *move, "--request", never).json["offset"] for _ in range(2)] == [[4], [4]]
    assert scenectl("scene", "log", "kitchen", "--json", profile=profile).json["position"] == told["position"] + 1
    for wrong in ("0f@3", "0f" * 16):
        assert "--request" in space(profile, *move, "--request", wrong).refusal(2)


def test_all_nodes_take_records_of_a_new_space_at_once(profile: str) -> None:
    number = made(profile, "wide", "--dimensions", "4")
    put(profile, number, "1", "5", "9", "d")
    listed = space(profile, "list").json
    assert [entry["name"] for entry in listed["spaces"] if not entry["parent"]][-1] == "wide"
    assert listed["spaces"][-1]["created"] <= listed["position"]
    text = scenectl("space", "list", "--scene", "kitchen", profile=profile).out.decode()
    assert "geometry" in text and "wide" in text


def test_a_managed_space_lists_ids(profile: str) -> None:
    made(profile, "results", "--managed")
    assert space(profile, "query", "results").json["records"] == []
    for box in ("0,0,0:1,1,1", "0:1"):
        assert "nodes choose" in space(profile, "query", "results", "--box", box).refusal(1), "however many coordinates it has"
    assert "no box" in space(profile, "create", "sums", "--managed", "--box", "0,0,0:1,1,1").refusal(2)
    for managed in ("results", "renders"):
        refused = scenectl("data", "put", managed, "0a", "-", "--scene", "kitchen", profile=profile, stdin=b"x")
        assert "nodes choose" in refused.refusal(2)
    assert "no positions" in space(profile, "scale", "results", "--by", "2").refusal(1)
    assert "no positions" in space(profile, "translate", "results", "--by", "1").refusal(1)


def test_imported_geometry_is_asked_by_box_and_stays_where_it_is(profile: str, tmp_path: Path) -> None:
    file = tmp_path / "square.obj"
    file.write_text(CUBE)
    done = scenectl("scene", "import", file, "--scene", "kitchen", profile=profile)
    assert done.code == 0, done.err
    inside = space(profile, "query", "geometry", "--box", "0.2,0.2,-0.1:0.8,0.8,0.1").json["records"]
    assert len(inside) == 1 and inside[0]["position"] == pytest.approx([0.5, 0.5, 0.0], abs=1e-3)
    assert space(profile, "query", "geometry", "--box", "0,0,-0.1:0.2,0.2,0.1").json["records"] == []
    assert "imported content" in space(profile, "translate", "geometry", "--by", "1,0,0").refusal(1)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["query", "hall", "--box", "5,5,5:6,6,6"], "lies outside of the space"),
        (["query", "attic", "--box", "0:1"], "no space 'attic'"),
        (["query", "999"], "no such space"),
        (["translate", "hall", "--by", "1e15,0,0"], "so far off for its size"),
        (["translate", "hall", "--by", "1e15,0,0"], "scale it up first, or leave it nearer"),
        (["scale", "hall", "--by", "1e-320"], "less than numbers hold"),
        (["create", "hall"], "has a space 'hall' already, its number is"),
        (["create", "shade", "--parent", "attic"], "no space 'attic'"),
    ],
)
def test_what_cannot_be_is_one_line(profile: str, hall: str, arguments: list[str], complaint: str) -> None:
    assert complaint in space(profile, *arguments).refusal(1)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["query", "hall", "--box", ",".join("0" * 17) + ":" + ",".join("1" * 17)], "1 to 8 dimensions"),
        (["query", "hall", "--box", "0,0:1,1"], "3 coordinates here, not 2"),
        (["query", "hall", "--box", "0,2,0:1,1,1"], "ends at 1 before it begins at 2 on axis 1"),
        (["query", "hall", "--box", "0,nan,0:1,1,1"], "not a number"),
        (["translate", "hall", "--by", "1,2"], "3 coordinates here, not 2"),
        (["create", "flat", "--box", "0,0:1,0"], "ends at 0 where it begins at 0 on axis 1"),
        (["create", "endless", "--box", "0:inf"], "finite"),
        (["create", "deep", "--box", "0:1", "--dimensions", "2"], "has 2 coordinates, not 1"),
        (["create", "shade", "--parent", "hall", "--box", "0,0,0:1,1,1"], "of its parent"),
        (["create", "shade", "--offset", "80"], "only a shadow has an offset"),
        (["create", "few", "--copies", "2", "--min-copies", "3"], "not 3 of 2"),
        (["create", "few", "--copies", "2", "--copies-min", "3"], "not 3 of 2"),
        (["create", "12"], "not all of them digits"),
    ],
)
def test_what_is_malformed_is_wrong_usage(profile: str, hall: str, arguments: list[str], complaint: str) -> None:
    assert complaint in space(profile, *arguments).refusal(2)


def test_records_are_named_by_the_space_that_holds_them(profile: str) -> None:
    number = made(profile, "sparks")
    kitchen = ("--scene", "kitchen", "--json")
    done = scenectl("data", "put", "sparks", "0a", "-", *kitchen, profile=profile, stdin=b"a spark")
    assert done.code == 0 and done.json["space"] == number, done.err
    assert scenectl("data", "get", "sparks", "0a", "--scene", "kitchen", profile=profile).out == b"a spark"
    for name in ("sparks", str(number)):
        listed = scenectl("data", "ls", name, *kitchen, profile=profile).json
        assert (listed["space"], [location[:2] for location in listed["locations"]]) == (number, ["0a"])
    assert scenectl("data", "delete", "sparks", "0a", *kitchen, profile=profile).json["space"] == number
    assert "there is no record" in scenectl("data", "get", "sparks", "0a", "--scene", "kitchen", profile=profile).refusal(1)
    assert "no space 'attic'" in scenectl("data", "ls", "attic", *kitchen, profile=profile).refusal(1)


def test_copies_are_said_and_listed(profile: str) -> None:
    parent = made(profile, "safe", "--box", "0,0:4,4", "--curve", "z-order")
    assert made(profile, "vault", "--copies", "1") == parent + 3, "its shadows have the numbers between"
    assert space(profile, "translate", "safe", "--by", "1,2").code == 0
    spaces = {entry["name"]: entry for entry in space(profile, "list").json["spaces"]}
    safe = spaces["safe"]
    assert (safe["copies"], safe["copies_min"], safe["parent"], safe["shadows"]) == (3, 2, 0, [parent + 1, parent + 2])
    for number, digit in ((1, "5"), (2, "a")):
        shade = spaces[f"safe copy {number}"]
        assert (shade["space"], shade["parent"], shade["copy_offset"], shade["shadows"]) == (parent + number, parent, digit * 40, [])
        assert (shade["dimensions"], shade["curve"], shade["world_low"]) == (2, "z-order", [1, 2])
        for name in (shade["name"], str(shade["space"])):
            copied = scenectl("data", "put", name, "0a", "-", "--scene", "kitchen", profile=profile, stdin=b"by hand").refusal(2)
            assert f"write to space {parent}, whose shadow it is" in copied, "copies are the nodes' to keep"
            assert f"list space {parent}" in scenectl("data", "ls", name, "--scene", "kitchen", profile=profile).refusal(2)
    text = scenectl("space", "list", "--scene", "kitchen", profile=profile).out.decode()
    assert "3, at least 2" in text and "safe copy" not in text
    text = scenectl("space", "list", "--all", "--scene", "kitchen", profile=profile).out.decode()
    assert "safe copy 1" in text and "shadow of safe" in text
    said = space(profile, "copies", "safe", "3", "--min-copies", "1").json
    assert (said["name"], said["copies"], said["copies_min"]) == ("safe", 3, 1)
    fewer = space(profile, "copies", "safe", "2").json
    assert (fewer["copies"], fewer["copies_min"]) == (2, 1) and fewer["copies_since"] > fewer["created"]
    more = space(profile, "copies", "safe", "3").json
    assert (more["copies"], more["copies_min"]) == (3, 1) and more["copies_since"] > fewer["copies_since"]
    assert fewer["shortages"] == more["shortages"] == []
    done = scenectl("space", "copies", "vault", "4", "--scene", "kitchen", profile=profile)
    said, decided = done.out.decode().splitlines()
    assert said == "Space vault shall have 4 copies, at least 2 before a record counts as stored."
    position = scenectl("scene", "log", "kitchen", "--json", profile=profile).json["position"]
    assert decided == f"Decided at position {position} of the scene's log."
    few = "in spaces with 4 copies only 3 of them can be there: the cluster has 3 nodes"
    assert done.err.splitlines() == [
        f"warning: space vault is degraded from the start: {few}: add a node, and the copies are made: scenectl cluster invite --node"
    ]
    many = space(profile, "create", "many", "--copies", "5")
    (short,) = many.json["shortages"]
    assert (many.code, short["address"], short["possible"], short["writes_refused"]) == (0, None, 3, False)
    assert "in spaces with 5 copies only 3 of them" in short["text"] and "add 2 nodes" in short["to_do"]
    assert many.err.count("\n") == 1, "one line, with --json as well"
    spaces = {entry["name"]: entry for entry in space(profile, "list").json["spaces"]}
    assert spaces["vault"]["shadows"] == [parent + 4, parent + 5, parent + 6]
    assert spaces["geometry"]["copies"] == 3, "by default, also in the spaces that every scene has"
    assert space(profile, "copies", "geometry", "3", "--min-copies", "1").json["copies_min"] == 1
    info = scenectl("scene", "info", "kitchen", "--json", profile=profile).json
    assert info["spaces_lacking_shadows"] == []


def test_copies_that_cannot_be(profile: str, hall: str) -> None:
    made(profile, "crypt", "--copies", "2")
    assert "holds the copies of the space 'crypt'" in space(profile, "copies", "crypt copy 1", "3").refusal(1)
    assert "no space 'attic'" in space(profile, "copies", "attic", "3").refusal(1)
    assert "no such space" in space(profile, "copies", "999", "3").refusal(1)
    assert "not 3 of 2" in space(profile, "copies", "hall", "2", "--min-copies", "3").refusal(2)
    assert "is a shadow" in space(profile, "translate", "crypt copy 1", "--by", "1,1,1").refusal(1)
    shadow = "create", "shade", "--parent"
    assert "takes no shadow" in space(profile, *shadow, "hall").refusal(1)
    assert "takes no shadow" not in space(profile, *shadow, "crypt").refusal(1)
    assert "an offset of 0 is the record's own place" in space(profile, *shadow, "crypt", "--offset", "0").refusal(2)
    assert "with this offset already" in space(profile, *shadow, "crypt", "--offset", "80").refusal(1)
    assert "is a shadow itself, and has none of its own" in space(profile, *shadow, "crypt copy 1").refusal(1)
    assert "one copy itself" in space(profile, *shadow, "crypt", "--copies", "2").refusal(2)
    long = "é" * 32
    assert made(profile, long, "--copies", "2")
    assert "é" * 28 + " copy 1" in [entry["name"] for entry in space(profile, "list").json["spaces"]]


@pytest.fixture(scope="module")
def hall(profile: str) -> str:
    made(profile, "hall", "--copies", "1")
    return "hall"


def kitchen(profile: str, *arguments: str, stdin: bytes = b"") -> Done:
    return scenectl(*arguments, "--scene", "kitchen", "--json", profile=profile, stdin=stdin)


def test_a_record_is_split_read_and_merged(profile: str) -> None:
    made(profile, "shelf", "--dimensions", "3")
    whole = bytes(range(256)) * 30
    assert kitchen(profile, "data", "put", "shelf", "0a", "-", stdin=whole).code == 0
    planned = kitchen(profile, "data", "split", "shelf", "0a", "--parts", "3", "--dry-run").json
    assert (planned["changed"], planned["dry_run"], planned["cut"], len(planned["parts"])) == (False, True, "bytes", 3)
    split = kitchen(profile, "data", "split", "shelf", "0a", "--parts", "3").json
    assert (split["changed"], split["bytes"], split["parts"]) == (True, len(whole), planned["parts"])
    assert kitchen(profile, "data", "split", "shelf", "0a", "--parts", "3").json["changed"] is False
    assert scenectl("data", "get", "shelf", "0a", "--scene", "kitchen", profile=profile).out == whole
    assert kitchen(profile, "data", "ls", "shelf").json["locations"] == [split["location"]]
    assert sorted([*split["parts"], split["location"]]) == kitchen(profile, "data", "ls", "shelf", "--deleted").json["locations"]
    looked = space(profile, "tidy", "shelf", "--dry-run").json
    assert (looked["in_use"], looked["removed"], looked["records"]) == (3, 0, 4)
    text = scenectl("data", "split", "shelf", "0a", "--parts", "3", "--scene", "kitchen", profile=profile).out.decode()
    assert "is split already into 3 parts by bytes" in text
    merged = kitchen(profile, "data", "merge", "shelf", "0a").json
    assert (merged["changed"], merged["parts"]) == (True, split["parts"])
    assert kitchen(profile, "data", "merge", "shelf", "0a").json["changed"] is False
    assert scenectl("data", "get", "shelf", "0a", "--scene", "kitchen", profile=profile).out == whole
    kitchen(profile, "data", "split", "shelf", "0a")
    kitchen(profile, "data", "put", "shelf", "0a", "-", stdin=b"an edit")
    assert space(profile, "tidy", "shelf").json["removed"] == 2
    kitchen(profile, "data", "split", "shelf", "0a")
    kitchen(profile, "data", "delete", "shelf", "0a")
    assert space(profile, "tidy", "shelf").json["in_use"] == 0


@pytest.mark.parametrize(
    ("arguments", "code", "complaint"),
    [
        (["split", "nook", "0b"], 1, "there is no record"),
        (["merge", "nook", "0b"], 1, "there is no record"),
        (["split", "nook", "0a", "--parts", "9"], 1, "too small to split"),
        (["split", "nook", "0a", "--by", "triangles"], 1, "no geometry atom"),
        (["split", "nook", "0a", "--parts", "1"], 2, "--parts"),
        (["split", "nook", "0a", "--parts", "257"], 2, "--parts"),
        (["split", "attic", "0a"], 1, "no space 'attic'"),
        (["split", "renders", "0a"], 1, "nodes choose"),
        (["merge", "geometry copy 1", "0a"], 2, "shadow"),
    ],
)
def test_what_cannot_be_split(profile: str, nook: str, arguments: list[str], code: int, complaint: str) -> None:
    assert complaint in kitchen(profile, "data", *arguments).refusal(code)


@pytest.fixture(scope="module")
def nook(profile: str) -> str:
    """A space with one small record."""
    made(profile, "nook")
    assert kitchen(profile, "data", "put", "nook", "0a", "-", stdin=b"tiny").code == 0
    return "nook"


def test_coordinates_are_written_anew_where_their_space_lies_now(profile: str) -> None:
    made(profile, "field", "--box", "0,0,0:1,1,1")
    row = struct.pack("<3f", 0.5, 0.25, 0.125)
    for place, payload in (("0a", row), ("0b", b"no row")):
        assert kitchen(profile, "data", "put", "field", place, "-", stdin=payload).code == 0
    assert space(profile, "rebase", "field", "--holds", "float32").json["behind"] == 0
    assert space(profile, "translate", "field", "--by", "1,2,3").code == 0
    looked = space(profile, "rebase", "field", "--holds", "float32", "--dry-run")
    assert (looked.code, looked.json["behind"], looked.json["rebased"]) == (5, 2, 0)
    done = space(profile, "rebase", "field", "--holds", "float32")
    assert (done.code, done.json["rebased"], done.json["unknown"]) == (5, 1, 1)
    moved = scenectl("data", "get", "field", "0a", "--scene", "kitchen", profile=profile).out
    assert struct.unpack("<3f", moved) == (1.5, 2.25, 3.125)
    assert space(profile, "rebase", "field", "--holds", "float32").json["behind"] == 1
    assert "renders" not in space(profile, "rebase", "field", "--holds", "rows").refusal(2)
