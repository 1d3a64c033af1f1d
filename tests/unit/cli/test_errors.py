"""If this fails, users see tracebacks, or scripts read a wrong exit code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from scenectl.draining import could_leave, leave, plan_text
from scenectl.errors import Interrupted, ending_of
from scenectl.program import main
from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, Unreachable, UsageFault
from scenefold.base.reasons import RejectReason
from scenefold.client import DrainReport

CODES = [
    (UsageFault("w"), 2),
    (LocalFault("w"), 1),
    (Unreachable("w"), 3),
    (PeerFault("w"), 1),
    (DamagedData("w"), 1),
    (Refused(RejectReason.MODE_FORBIDS, "w"), 4),
    (Refused(RejectReason.NO_MAJORITY, "w"), 4),
    (Refused(RejectReason.NOT_AUTHORISED, "w"), 4),
    (Refused(RejectReason.STALE_VERSION, "w"), 4),
    (Refused(RejectReason.STORAGE_FULL, "w"), 1),
    (KeyboardInterrupt(), 130),
    (Interrupted(), 130),
    (OSError(28, "No space left on device", "/x"), 1),
    (MemoryError(), 1),
    (ZeroDivisionError("division by zero"), 1),
]


@pytest.mark.parametrize(("error", "code"), CODES, ids=lambda value: getattr(value, "args", value))
def test_exit_codes(error: BaseException, code: int) -> None:
    assert ending_of(error).exit_code == code
    assert ending_of(BaseExceptionGroup("in a nursery", [error])).exit_code == code


def test_a_refusal_has_its_reason_by_name() -> None:
    """Scripts need not read the words."""
    document = ending_of(Refused(RejectReason.NO_MAJORITY, "w", where="127.0.0.2")).document()
    assert document == {
        "error": {"kind": "refused", "what": "w", "where": "127.0.0.2", "remedy": "", "reason": "no_majority"},
        "exit_code": 4,
    }
    assert "reason" not in str(ending_of(Unreachable("w")).document())


def test_the_line_says_what_where_and_what_to_do() -> None:
    ending = ending_of(LocalFault("the port\nis taken", where="127.0.0.2:17349", remedy="stop the other node"))
    assert ending.line == "the port is taken (127.0.0.2:17349): stop the other node"


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("node:2130706437 is not among the job's nodes", "node:127.0.0.5 is not among the job's nodes"),
        ("the key of node:2130706437 is revoked", "the key of node:127.0.0.5 is revoked"),
        ("between node:2130706437, node:2130706438.", "between node:127.0.0.5, node:127.0.0.6."),
        ("node:4294967296 and node:127.0.0.5", "node:4294967296 and node:127.0.0.5"),
        ("node:02130706437, node:21307064370", "node:02130706437, node:21307064370"),
        ("the scene has no space 'node:2130706437'", "the scene has no space 'node:2130706437'"),
        ("anode:2130706437, node:x, user:5", "anode:2130706437, node:x, user:5"),
    ],
)
def test_nodes_are_named_by_their_address(said: str, shown: str) -> None:
    """Nodes speak of each other by number, and people of theirs by address."""
    for error in (Refused(RejectReason.NOT_AUTHORISED, said), Unreachable("w", where=said), LocalFault("w", remedy=said)):
        ending = ending_of(error)
        assert shown in (ending.what, ending.where, ending.remedy) and shown in ending.line


def test_of_a_group_the_telling_error_is_shown() -> None:
    group = BaseExceptionGroup("", [ValueError("x"), BaseExceptionGroup("", [Unreachable("no node answers")])])
    assert ending_of(group).what == "no node answers"


def test_our_own_bugs_ask_for_a_report() -> None:
    ending = ending_of(ZeroDivisionError("division by zero"))
    assert ending.kind == "bug"
    assert "--debug" in ending.remedy


FALLS_IN_A_NURSERY = """
import sys, trio, scenectl.cluster, scenectl.program
async def work():
    async with trio.open_nursery():
        while True:
            print("a line", flush=True)
scenectl.cluster._look = lambda profile: trio.run(work)
sys.exit(scenectl.program.main(["cluster", "status"]))
"""


@pytest.mark.parametrize("program", [["-m", "scenectl", "--help"], ["-c", FALLS_IN_A_NURSERY]], ids=["a page", "lines without end"])
def test_when_nobody_reads_any_more_it_ends_quietly(program: list[str]) -> None:
    reader, writer = os.pipe()
    with subprocess.Popen([sys.executable, *program], stdout=writer, stderr=subprocess.PIPE) as process:
        os.close(writer)
        os.close(reader)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (141, b"")


@pytest.mark.parametrize(
    ("arguments", "is_json"),
    [
        (("--json",), True),
        (("--json=true",), True),
        (("--json=YES",), True),
        (("--json=nonsense",), True),
        (("--json=false",), False),
        (("--jsonx",), False),
        (("--", "--json"), False),
        (("--json", "--", "--json"), True),
    ],
)
def test_an_error_has_its_object_as_the_result_would(arguments: tuple[str, ...], is_json: bool, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["key", "show", "--profile", "nowhere", *arguments]) in (1, 2)
    assert bool(capsys.readouterr().out) == is_json


def test_a_plan_to_drain_says_what_would_move_and_what_keeps_it() -> None:
    plan = DrainReport("serving", 5_000, 3 << 20, None, False, ("it owns a part of the line",), "", room_bytes=8 << 20)
    assert could_leave(plan) and "5,000 records, 3.0 MiB" in plan_text("127.0.0.4", plan)
    assert "room for 8.0 MiB." in plan_text("127.0.0.4", plan)
    narrow = replace(plan, room_bytes=1 << 20)
    assert not could_leave(narrow) and "might have to wait" in plan_text("127.0.0.4", narrow)
    voter = replace(plan, cannot_leave="this node decides the cluster's log")
    assert not could_leave(voter) and "would refuse: this node decides" in plan_text("127.0.0.4", voter)
    early = replace(plan, room_bytes=None)
    assert could_leave(early) and "room" not in plan_text("127.0.0.4", early)


async def test_a_cancelled_drain_is_a_refusal() -> None:
    serving = DrainReport("serving", 5, 100, None, False, (), "")

    class Cancelled:
        calls = SimpleNamespace(world=SimpleNamespace(clock=SimpleNamespace(now=lambda: 0.0)))

        async def drain(self, address: str) -> DrainReport:
            return serving

    cluster: Any = Cancelled()
    with pytest.raises(Refused, match="cancelled") as refused:
        await leave(cluster, "127.0.0.4", lambda _: None)
    ending = ending_of(refused.value)
    assert (ending.kind, ending.exit_code) == ("refused", 4)


@pytest.mark.parametrize("verb", [["cluster", "status"], ["--help"], ["cluster", "status", "--json"]])
def test_without_an_output_it_says_so_and_does_nothing(verb: list[str]) -> None:
    done = subprocess.run(
        ["/bin/sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "scenectl", *verb], capture_output=True, timeout=60
    )
    assert done.returncode == 1
    assert done.stderr == b"error: there is nowhere to write (standard output is closed): send it to a file, or to /dev/null\n"


def test_without_an_input_nothing_is_stored() -> None:
    put = ["-m", "scenectl", "data", "put", "files", "0a", "-", "--scene", "kitchen"]
    done = subprocess.run(["/bin/sh", "-c", 'exec "$@" <&-', "sh", sys.executable, *put], capture_output=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr == b"error: there is nothing to read (standard input is closed): name a file, or send it one\n"


def test_without_standard_error_results_are_nothing_but_results() -> None:
    wrong = ["-m", "scenectl", "cluster", "status", "--json", "--colour"]
    done = subprocess.run(["/bin/sh", "-c", 'exec "$@" 2>&-', "sh", sys.executable, *wrong], capture_output=True, timeout=60)
    assert (done.returncode, done.stderr) == (2, b"")
    assert json.loads(done.stdout)["exit_code"] == 2
