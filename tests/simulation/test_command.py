"""If this fails, the command hides what it found, says it so that nobody can use it, or takes nonsense for an order."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from dataclasses import replace

import pytest

from scenefold.simulation import __main__ as program
from scenefold.simulation import laws
from scenefold.simulation.crowd import run_one
from scenefold.simulation.outcome import FAULTS_MIN, OPERATIONS_MIN, Order, Result
from scenefold.simulation.shrink import Shortened
from scenefold.world.sim.datagrams import SimDatagrams
from simulation.runs import command

KEYS = {"seeds", "violations", "faults", "operations", "operations_min", "faults_min", "reported", "short"}
MUTANT = ("--mutant", "version check", "--seconds", "20", "--faults", "connection reset,duplication")


def test_the_report_of_seeds_that_hold() -> None:
    done = command("--seeds", "3:5", "--json", "--workload", "data", "--seconds", "20")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert set(report) == KEYS
    assert (report["seeds"], report["violations"], report["short"]) == (2, [], [])
    assert report["operations"] >= 2 * report["operations_min"] >= 2 * OPERATIONS_MIN
    assert sum(report["faults"].values()) >= 2 * report["faults_min"] >= 2 * FAULTS_MIN


def test_a_violation_is_reported_told_shortened_and_shown_again() -> None:
    done = command("--replay", "0", *MUTANT, "--json")
    assert done.returncode == 1, done.stderr
    report = json.loads(done.stdout)
    assert set(report) == KEYS and report["seeds"] == 1
    (found, *_) = report["violations"]
    assert (found["seed"], found["law"]) == (0, laws.LINEARIZABLE) and found["what"] and found["at_s"] > 0
    _, _, story = done.stderr.partition("\nseed 0: ")
    for part in ("violation", laws.LINEARIZABLE, "faults:", "what happened:", "put ", "VIOLATED linearizable", "again: "):
        assert part in story, part
    whole, shorter = shlex.split(found["replay"]), shlex.split(story.partition("again: ")[2].splitlines()[0])
    assert whole[:3] == shorter[:3] == ["python", "-m", "scenefold.simulation"]
    assert "--keep" in shorter and "--keep" not in whole
    again = command(*shorter[3:], "--json", "--no-shorten")
    assert again.returncode == 1
    assert laws.LINEARIZABLE in {violation["law"] for violation in json.loads(again.stdout)["violations"]}


@pytest.fixture(scope="module")
def violated() -> Result:
    """A seed that fails."""
    return run_one(Order(0, mutant="version check", storm_s=20.0))


def fed(monkeypatch: pytest.MonkeyPatch, *results: Result) -> None:
    """The command is given these results."""

    def run_all(_orders: object, _jobs: int) -> Iterator[Result]:
        yield from results

    monkeypatch.setattr(program, "run_all", run_all)


def test_the_report_is_out_before_shortening_and_the_story_though_it_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], violated: Result
) -> None:
    fed(monkeypatch, violated)
    reported: list[str] = []

    def shorten(*_: object) -> Shortened[int]:
        reported.append(capsys.readouterr().out)
        raise KeyboardInterrupt

    monkeypatch.setattr(program, "shorten", shorten)
    assert program.main(["--replay", "0", "--json"]) == 1
    assert json.loads(reported[0])["violations"]
    assert "what happened:" in capsys.readouterr().err


def test_without_json_each_violation_has_a_line_and_its_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], violated: Result
) -> None:
    fed(monkeypatch, violated)
    assert program.main(["--replay", "0", "--no-shorten"]) == 1
    told = capsys.readouterr().out
    assert told.startswith("1 seeds, ") and "seed 0: linearizable: " in told and violated.order.replay in told


def test_a_seed_that_tests_too_little_is_a_failure_of_the_harness(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], violated: Result
) -> None:
    enough = replace(violated, violations=(), operations=OPERATIONS_MIN, faults={"crash": FAULTS_MIN})
    for result, what in (
        (replace(enough, operations=OPERATIONS_MIN - 1), "299 acknowledged operations of 300 at least"),
        (replace(enough, faults={"crash": 4}), "4 faults of 5 at least"),
    ):
        fed(monkeypatch, enough, result)
        assert program.main(["--seeds", "0:2", "--json"]) == 3
        output = capsys.readouterr()
        assert json.loads(output.out)["short"] == [{"seed": 0, "what": what}]
        assert f"the harness falls short: seed 0 had only {what}" in output.err
    fed(monkeypatch, enough)
    assert program.main(["--replay", "0", "--json"]) == 0
    short = replace(enough, operations=1)
    assert replace(short, order=replace(short.order, keep=(1,))).shortage == "", "a shortened run may be short"
    assert replace(violated, operations=1).shortage == "", "a run that broke off may be short"


def test_a_bug_in_an_event_is_a_finding_of_its_seed_and_loses_no_other(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def arrive(*_: object) -> bool:
        raise KeyError("a bug in an event")

    monkeypatch.setattr(SimDatagrams, "arrive", arrive)
    assert program.main(["--seeds", "0:2", "--jobs", "1", "--json", "--no-shorten"]) == 1
    output = capsys.readouterr()
    report = json.loads(output.out)
    assert [(found["seed"], found["law"]) for found in report["violations"]] == [(0, laws.SOUND), (1, laws.SOUND)]
    assert all(found["what"].startswith("KeyError: 'a bug in an event'") for found in report["violations"])
    assert "again: " in output.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--seeds 5:3", "'5:3' holds no seed"),
        ("--seeds 5:5", "'5:5' holds no seed"),
        ("--seeds x", "'x' is no range of seeds such as 0:200"),
        ("--seeds 0:99999999999", "holds more than"),
        ("--replay -1", "-1 is not from 0"),
        ("--replay 1 --seeds 0:3", "not allowed with"),
        ("--nodes 0", "0 is not from 3 to 64"),
        ("--nodes 1", "1 is not from 3 to 64"),
        ("--nodes many", "'many' is no number from 3 to 64"),
        ("--workload foo", "invalid choice: 'foo'"),
        ("--mutant nobody", "invalid choice: 'nobody'"),
        ("--seconds 1", "1 is not from 20"),
        ("--seconds nan", "nan is not from 20"),
        ("--jobs 0", "0 is not from 1"),
        ("--nonsense", "unrecognized arguments: --nonsense"),
        ("--keep 1", "give --replay"),
        ("--replay 1 --keep 99", "does not have"),
        ("--replay 1 --keep a", "no list of faults"),
        ("--trace x --seeds 0:2", "give --replay"),
        ("--faults rain", "no list of kinds of faults; there are: partition, "),
        ("--faults join,drain --workload data", "leaves all of these"),
        ("--trace /nowhere/x --replay 1", "No such file"),
        ("--participants 3", "--participants is for --workload logs"),
        ("--workload logs --participants 99", "99 is not from 0 to 33"),
        ("--workload logs --participants 7 --nodes 5", "--nodes 5 are fewer than the 7 participants of seed 0"),
        ("--workload logs --seeds 0:3 --nodes 5", "--nodes 5 are fewer than the 7 participants of seed 2"),
    ],
)
def test_wrong_usage_is_one_line_and_ends_with_two(arguments: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        program.main(arguments.split())
    output = capsys.readouterr()
    assert (ended.value.code, output.out, output.err.count("\n")) == (2, "", 1)
    assert said in output.err
