"""If this fails, what is measured of deciding is another number than the report says, or a mistyped measurement begins."""

from __future__ import annotations

from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenectl.bench_killed import killed
from scenectl.bench_log import Turn, bench_text
from scenectl.program import main
from scenefold.base.errors import Refused, Unreachable
from scenefold.base.reasons import RejectReason


class Clock:
    """Time that passes only where somebody says so."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr("time.monotonic", lambda: self.now)

    async def takes(self, seconds: float, error: Exception | None = None) -> None:
        self.now += seconds
        await trio.lowlevel.checkpoint()
        if error is not None:
            raise error


async def test_what_was_told_makes_the_figures_and_refusals_are_counted_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    turn = Turn(seconds=2.0, cpu_s=0.3, packets=60)

    for seconds in (0.1, 0.2, 0.3):
        await turn.one(lambda seconds=seconds: clock.takes(seconds))  # type: ignore[misc]
    await turn.one(lambda: clock.takes(9.0, Refused(RejectReason.BUSY, "others change it")))
    await turn.one(lambda: clock.takes(9.0, Unreachable("nobody knows")))
    found = turn.document()
    assert (found["commits"], found["refused"], found["unknown"]) == (3, 1, 1)
    assert found["commits_per_s"] == pytest.approx(1.5) and found["packets_per_commit"] == pytest.approx(20.0)
    assert found["p50_ms"] == pytest.approx(200.0) and found["p99_ms"] == pytest.approx(298.0)
    assert found["cpu_ms_per_commit"] == pytest.approx(100.0)


def test_where_nothing_was_committed_there_are_no_figures() -> None:
    found = Turn(refused=4, seconds=1.0).document()
    assert (found["commits_per_s"], found["p50_ms"], found["packets_per_commit"], found["cpu_ms_per_commit"]) == (0.0, None, None, None)
    assert "4 and 0 of 4" in bench_text(_report(found))


def test_people_are_told_all_of_it() -> None:
    turn = Turn([0.01, 0.02, 0.03], seconds=1.0, cpu_s=0.3, packets=60).document()
    killed = {"next_commit_s": [0.5, 6.25], "goal_s": 5.0, "is_reached": False}
    simulated = {"participants": 33, "link_ms": 1.0, "commits_per_s": 7.4, "p50_ms": 134.0, "p99_ms": 140.0, "packets_per_commit": 160.0}
    lines = bench_text(_report(turn, killed=killed, simulated=[simulated])).splitlines()
    assert [line.split()[:2] for line in lines[1:4]] == [["5", "one"], ["5", "16"], ["5", "16"]]
    assert "0 and 0 of 3" in lines[1]
    assert "0.50, 6.25 s (goal: 5 s, missed)" in lines[-2]
    assert lines[-1].startswith("33 participants, simulated, 1 ms a link: 7 commits/s, median 134 ms, 99 % 140 ms, 160 packets")


def _report(turn: dict[str, Any], *, simulated: list[dict[str, Any]] | None = None, **more: Any) -> dict[str, Any]:
    row = {"participants": 5, "one_client": turn, "one_scene": turn, "a_scene_each": turn, **more}
    return {"clients": 16, "participants": [row], "simulated": simulated or []}


class Nodes:
    """What `killed` needs of a cluster: it notes who is ended when, and who is back."""

    def __init__(self) -> None:
        self.dead: set[str] = set()
        self.deaths: list[tuple[str, float]] = []

    async def kill(self, address: str) -> None:
        self.dead.add(address)
        self.deaths.append((address, trio.current_time()))

    def start(self, address: str) -> None:
        self.dead.remove(address)

    async def wait(self, addresses: list[str]) -> None:
        assert not self.dead & {*addresses}


async def test_who_proposes_dies_under_a_proposal_and_the_next_commit_of_somebody_else_counts(
    monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock
) -> None:
    nodes = Nodes()
    monkeypatch.setattr("time.monotonic", trio.current_time)
    monkeypatch.setattr("scenectl.bench_killed.proposer_of", lambda _: "127.0.0.2")

    async def one() -> Any:
        await trio.sleep(0.4)
        if nodes.dead:
            raise Unreachable("nobody knows")

    async def other() -> Any:
        if nodes.dead and trio.current_time() < nodes.deaths[-1][1] + 3.0:
            await trio.sleep(0.5)
            raise Refused(RejectReason.NO_MAJORITY, "not now")
        await trio.sleep(0.25)

    found = await killed(nodes, one, other, 3, 3.0)  # type: ignore[arg-type]
    assert [address for address, _ in nodes.deaths] == ["127.0.0.2"] * 3 and not nodes.dead
    assert found["next_commit_s"] == pytest.approx([3.25] * 3), "what is refused is no commit"
    assert found["own_unknown"] == 3 and found["own_commit_s"] == []
    assert not found["is_reached"]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ("--participants 0", "--participants"),
        ("--participants 34", "33"),
        ("--participants none --simulated 34", "33"),
        ("--participants three", "--participants"),
        ("--commits 101", "--commits"),
        ("--clients 0", "--clients"),
        ("--kills -1", "--kills"),
    ],
)
def test_what_no_scene_can_have_is_wrong_usage(arguments: str, word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "log", *arguments.split()]) == 2
    said = capsys.readouterr().err
    assert word in said and said.count("\n") == 1
