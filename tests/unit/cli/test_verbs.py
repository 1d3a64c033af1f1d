"""If this fails, a verb has lost its help, or wrong usage ends in a traceback or under the wrong exit code."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import cyclopts
import pytest
from rich.console import Console

from scenectl.program import GROUPS, main

VERBS = [
    "cluster init",
    "cluster status",
    "cluster health",
    "cluster join",
    "cluster nodes",
    "cluster top",
    "cluster invite",
    "cluster invitations",
    "cluster users",
    "cluster trust",
    "cluster voters",
    "cluster add-voter",
    "cluster remove-voter",
    "cluster revoke",
    "cluster renew",
    "node run",
    "node local",
    "node drain",
    "node blacklist add",
    "node blacklist rm",
    "node blacklist list",
    "node upkeep show",
    "node upkeep pause",
    "node upkeep resume",
    "node upkeep rate",
    "node verify",
    "node repair",
    "scene create",
    "scene list",
    "scene info",
    "scene import",
    "scene export",
    "scene import-archive",
    "scene grant",
    "scene access",
    "scene revoke",
    "scene rotate-key",
    "scene mode",
    "scene rm",
    "scene purge",
    "scene strays",
    "space create",
    "space list",
    "space copies",
    "space translate",
    "space scale",
    "space query",
    "space rebase",
    "space tidy",
    "data put",
    "data get",
    "data ls",
    "data delete",
    "data split",
    "data merge",
    "key show",
    "key passphrase",
    "key backup",
    "key export",
    "key import",
    "render still",
    "render report",
    "bench curve",
    "bench hostile",
    "bench log",
    "bench seal",
    "bench store",
    "bench render",
    "demo",
]


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example_and_json(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*verb.split(), "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"Example: scenectl {verb}" in text
    assert "--json" in text
    assert "--debug" in text


@pytest.mark.parametrize("verb", VERBS)
def test_help_breaks_lines_where_the_terminal_ends_and_nowhere_else(
    verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # An app keeps its console, which may have read a width from the environment when an earlier page was shown.
    monkeypatch.setattr(cyclopts.App, "console", property(lambda _app: Console(width=2000)))
    assert main([*verb.split(), "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert not [line for line in lines if re.match("│ {8}", line)], "a description goes on in a second line"
    prose = [bool(line) and line[0] not in "│╭╰" and not line.startswith("Example:") for line in lines]
    assert not [line for line, one, next_one in zip(lines, prose, prose[1:], strict=False) if one and next_one]
    assert "default: None" not in "".join(lines) and "default: False" not in "".join(lines)


def test_an_unknown_verb_is_answered_by_what_was_meant(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cluster", "statsu"]) == 2
    assert capsys.readouterr().err == (
        'error: Unknown command "statsu". Did you mean "status"? (scenectl cluster): see `scenectl cluster --help`\n'
    )


@pytest.mark.parametrize("group", sorted({verb.split()[0] for verb in VERBS}))
def test_the_first_page_names_every_group(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    assert group in capsys.readouterr().out
    assert group in GROUPS


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    from scenefold import __version__

    assert main(["--version"]) == 0
    assert __version__ in capsys.readouterr().out


WRONG = {
    "an unknown group": ["clster"],
    "an unknown verb": ["cluster", "statsu"],
    "an unknown option": ["cluster", "status", "--colour"],
    "a missing argument": ["scene", "create"],
    "a size of 0": ["render", "still", "a.glb", "--size", "0x4"],
    "a malformed size": ["render", "still", "a.glb", "--size", "640"],
    "a huge size": ["render", "still", "a.glb", "--size", "16385x9"],
    "a size with a sign": ["render", "still", "a.glb", "--size=-640x360"],
    "half a sample": ["render", "still", "a.glb", "--samples", "1.5"],
    "samples that are no number": ["render", "still", "a.glb", "--samples", "many"],
    "too many samples": ["render", "still", "a.glb", "--samples", "1048577"],
    "no segment of a path": ["render", "still", "a.glb", "--depth", "0"],
    "an exposure that is no number": ["render", "still", "a.glb", "--exposure", "nan"],
    "one port": ["render", "still", "a.glb", "--ports", "17349"],
    "one port twice": ["render", "still", "a.glb", "--ports", "17349,17349"],
    "a sky beyond measure": ["render", "still", "a.glb", "--sky", "1e10,1,1"],
    "an output that is no EXR": ["render", "still", "a.glb", "-o", "image.png"],
    "an output that is this folder": ["render", "still", "a.glb", "-o", "."],
    "an output without a name": ["render", "still", "a.glb", "-o", ""],
    "a scene in no cluster": ["render", "still", "--scene", "kitchen"],
    "half a node": ["node", "local", "1.5"],
    "no samples": ["render", "still", "a.glb", "--samples", "0"],
    "no nodes": ["render", "still", "a.glb", "--nodes", "0"],
    "too many nodes": ["render", "still", "a.glb", "--nodes", "128"],
    "an unknown algorithm": ["render", "still", "a.glb", "--algorithm", "octree"],
    "a sky of two numbers": ["render", "still", "a.glb", "--sky", "1,2"],
    "a dark sky below 0": ["render", "still", "a.glb", "--sky", "1,2,-3"],
    "a sky that is no number": ["render", "still", "a.glb", "--sky", "1,2,nan"],
    "a negative seed": ["render", "still", "a.glb", "--seed", "-1"],
    "a malformed address": ["cluster", "init", "x", "--nodes", "127.0.0.2,here"],
    "an address twice": ["cluster", "init", "x", "--nodes", "127.0.0.2,127.0.0.2"],
    "an address of a node and a spare": ["cluster", "init", "x", "--nodes", "127.0.0.2", "--spares", "127.0.0.3,127.0.0.2"],
    "no machine's address": ["cluster", "init", "x", "--nodes", "0.0.0.0"],
    "no machine's address for a spare": ["cluster", "init", "x", "--nodes", "127.0.0.2", "--spares", "224.0.0.1"],
    "a seed that is all machines": ["cluster", "join", "255.255.255.255"],
    "a node that is no machine": ["node", "run", "--address", "0.0.0.7"],
    "no address": ["cluster", "init", "x", "--nodes", ","],
    "a malformed location": ["data", "get", "1", "xyz", "--scene", "s"],
    "a long location": ["data", "get", "1", "0" * 41, "--scene", "s"],
    "a box of 17 dimensions": ["space", "query", "hall", "--scene", "s", "--box", ",".join("0" * 17) + ":" + ",".join("1" * 17)],
    "an inverted box": ["space", "create", "hall", "--scene", "s", "--box", "0,2,0:1,1,1"],
    "a box that is no number": ["space", "query", "hall", "--scene", "s", "--box", "0,nan,0:1,1,1"],
    "corners of different spaces": ["space", "query", "hall", "--scene", "s", "--box", "0,0:1,1,1"],
    "a move without end": ["space", "translate", "hall", "--scene", "s", "--by", "inf,0,0"],
    "a scale by 0": ["space", "scale", "hall", "--scene", "s", "--by", "0"],
    "a scale by less than 0": ["space", "scale", "hall", "--scene", "s", "--by", "-2"],
    "a scale by no number": ["space", "scale", "hall", "--scene", "s", "--by", "nan"],
    "no copies": ["space", "create", "hall", "--scene", "s", "--copies", "0"],
    "nine copies": ["space", "create", "hall", "--scene", "s", "--copies", "9"],
    "none that must be there": ["space", "create", "hall", "--scene", "s", "--copies", "2", "--min-copies", "0"],
    "no copies from now on": ["space", "copies", "hall", "0", "--scene", "s"],
    "nine copies from now on": ["space", "copies", "hall", "9", "--scene", "s"],
    "copies that are no number": ["space", "copies", "hall", "many", "--scene", "s"],
    "no number of copies": ["space", "copies", "hall", "--scene", "s"],
    "a malformed offset": ["space", "create", "hall", "--scene", "s", "--parent", "1", "--offset", "xyz"],
    "space 0": ["data", "get", "0", "00", "--scene", "s"],
    "a box of one corner": ["space", "query", "hall", "--box", "0,0,0", "--scene", "s"],
    "a box of words": ["space", "query", "hall", "--box", "a,b:c,d", "--scene", "s"],
    "a move of words": ["space", "translate", "hall", "--by", "up", "--scene", "s"],
    "nine dimensions": ["space", "create", "hall", "--dimensions", "9", "--scene", "s"],
    "an unknown curve": ["space", "create", "hall", "--curve", "peano", "--scene", "s"],
    "nodes that are no number": ["node", "local", "many"],
    "a range that ends before it begins": ["data", "ls", "1", "--scene", "s", "--first", "80", "--last", "7f"],
    "nothing to render": ["render", "still"],
    "nobody for a blacklist": ["node", "blacklist", "add", "--node", "127.0.0.2"],
    "nobody's blacklist": ["node", "blacklist", "add", "127.0.0.3"],
    "a prefix with bits behind it": ["node", "blacklist", "add", "10.1.2.3/24", "--node", "127.0.0.2"],
    "a prefix that is none": ["node", "blacklist", "rm", "10.1.2.0/33", "--node", "127.0.0.2"],
    "a word for a prefix": ["node", "blacklist", "rm", "10.1.2.0/24", "rack", "--node", "127.0.0.2"],
    "33 entries at once": ["node", "blacklist", "add", *(f"10.0.0.{number}" for number in range(1, 34)), "--node", "127.0.0.2"],
    "a prefix with bits behind it for a start": ["node", "run", "--address", "127.0.0.2", "--blacklist", "10.1.2.3/24"],
    "a prefix twice": ["node", "run", "--address", "127.0.0.2", "--blacklist", "10.1.2.0/24,10.1.2.0/24"],
    **{
        f"a name that cannot be: {verb} {what}": [*verb.split(), *what.split("|")]
        for verb, what in [
            ("scene create", "a b"),
            ("scene create", ""),
            ("scene create", "ä"),
            ("scene create", "x" * 65),
            ("scene info", "../x"),
            ("scene access", "a/b"),
            ("scene import", "a.glb|--scene|"),
            ("scene grant", "a b|user:ada"),
            ("scene grant", "kitchen|ada"),
            ("scene grant", "kitchen|user:"),
            ("scene grant", "kitchen|user:a b"),
            ("scene grant", "kitchen|node:4294967296"),
            ("scene revoke", "kitchen|user:a b"),
            ("scene revoke", "kitchen|nobody"),
            ("scene rotate-key", "a b"),
            ("space create", "12|--scene|kitchen"),
            ("space create", "|--scene|kitchen"),
            ("space create", "hall|--scene|a b"),
            ("space create", "hall|--scene|kitchen|--parent|a\x07"),
            ("space list", "--scene|a b"),
            ("space translate", "0|--by|1,1,1|--scene|kitchen"),
            ("space scale", "hall|--by|2|--scene|"),
            ("space copies", "0|2|--scene|kitchen"),
            ("space query", "ä" * 33 + "|--scene|kitchen"),
            ("data get", "hall\n|00|--scene|kitchen"),
            ("data ls", "geometry|--scene|.kitchen"),
            ("data put", "geometry|00|file|--scene|a:b"),
            ("data delete", "geometry|00|--scene|a:b"),
            ("render still", "a.glb|--scene|"),
            ("render still", "--scene|a b|--profile|studio"),
            ("cluster init", "x|--nodes|127.0.0.2|--name|a b"),
            ("cluster init", "a b|--nodes|127.0.0.2"),
            ("cluster invite", "--user|a b"),
            ("cluster invite", "--user|a@b"),
            ("cluster invite", "--user|" + "x" * 51),
            ("cluster invite", "--withdraw|"),
            ("cluster revoke", "user:a b"),
            ("cluster revoke", "user:"),
            ("cluster join", "127.0.0.2|--place|middle"),
            ("key show", "--user|../owner"),
            ("key passphrase", "--user|a b"),
            ("key export", "me.txt|--user|a b"),
        ]
    },
}


@pytest.mark.parametrize("arguments", WRONG.values(), ids=WRONG.keys())
def test_wrong_usage_is_one_line_and_exit_code_2(
    arguments: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SCENEFOLD_PROFILE", raising=False)
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1
    assert main([*arguments, "--json"]) == 2
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert document["exit_code"] == 2
    assert document["error"]["kind"] == "usage"
    assert document["error"]["what"]


def test_arguments_too_many_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cluster", "status", "extra"]) == 2
    assert capsys.readouterr().err.startswith("error: 'extra' is an argument too many (scenectl cluster status)")
    assert main(["cluster", "status", "one", "two"]) == 2
    assert "'one', 'two' are arguments too many" in capsys.readouterr().err


def test_a_missing_scene_file_is_a_failure_with_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "still", "nowhere.glb", "-o", "x.exr"]) == 1
    assert "nowhere.glb" in capsys.readouterr().err


def test_a_name_that_is_given_is_the_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cluster", "init", str(tmp_path / "x"), "--nodes", "127.0.0.2", "--name", ""]) == 2
    assert "'' cannot be the name of a cluster" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\n"
        "from scenectl.program import main\n"
        "main(['--help'])\n"
        "heavy = {'numpy', 'numba', 'trio', 'cryptography', 'lmdb', 'trimesh', 'OpenEXR'} & set(sys.modules)\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
