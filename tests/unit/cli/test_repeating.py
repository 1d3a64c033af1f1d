"""If this fails, nobody learns from scenectl how to repeat a change of which nobody knows, or repeats another thing than was meant."""

from __future__ import annotations

import json
from typing import Any

import pytest

from scenectl import running
from scenectl.program import main
from scenefold.client import InDoubt, Request

ID = "0f" * 16
REQUEST = f"{ID}@17"
AS_TOLD = "`scenectl scene status kitchen` tells"
ONE_CHANGE = [
    ["scene", "grant", "kitchen", "user:ada"],
    ["scene", "revoke", "kitchen", "user:ada"],
    ["scene", "rotate-key", "kitchen"],
    ["scene", "mode", "kitchen", "render"],
    ["scene", "settings", "kitchen", "--samples", "16"],
    ["scene", "settings", "kitchen", "--clear"],
    ["scene", "rm", "kitchen", "--yes"],
    ["scene", "add-participant", "kitchen", "127.0.0.2", "127.0.0.3"],
    ["scene", "remove-participant", "kitchen", "127.0.0.2"],
    ["scene", "add-observer", "kitchen", "127.0.0.2"],
    ["scene", "remove-observer", "kitchen", "127.0.0.2"],
    ["space", "create", "hall", "--scene", "kitchen"],
    ["space", "translate", "hall", "--by", "1,0,0", "--scene", "kitchen"],
    ["space", "scale", "hall", "--by", "2", "--scene", "kitchen"],
    ["space", "copies", "hall", "2", "--scene", "kitchen"],
]
NO_CHANGE = [
    ["scene", "revoke", "kitchen", "user:ada", "--dry-run"],
    ["scene", "rotate-key", "kitchen", "--dry-run"],
    ["scene", "rotate-key", "kitchen", "--resume"],
    ["scene", "mode", "kitchen"],
    ["scene", "settings", "kitchen"],
    ["scene", "rm", "kitchen", "--dry-run"],
    ["space", "copies", "hall", "2", "--dry-run", "--scene", "kitchen"],
]


@pytest.fixture(autouse=True)
def nobody_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*_: Any) -> None:
        request = Request(bytes.fromhex(ID), 17)
        raise InDoubt("it may have happened", where="scene kitchen", remedy=AS_TOLD, request=request)

    monkeypatch.setattr(running, "run", run)


@pytest.mark.parametrize("is_again", [False, True])
@pytest.mark.parametrize("verb", ONE_CHANGE, ids=" ".join)
def test_whoever_made_one_change_is_told_how_to_repeat_it(capsys: pytest.CaptureFixture[str], verb: list[str], is_again: bool) -> None:
    arguments = [*verb, *(["--request", f"{ID}@16"] if is_again else []), "--json", "--profile", "studio"]
    assert main(arguments) == 3
    told = capsys.readouterr()
    assert f"{AS_TOLD}; or repeat the very same command with `--request {REQUEST}`: then it happens once at most" in told.err
    error = json.loads(told.out)["error"]
    assert (error["kind"], error["request"]) == ("unreachable", REQUEST)


@pytest.mark.parametrize("verb", [["purge", "kitchen"], ["relieve", "127.0.0.2"]], ids=" ".join)
def test_where_the_same_command_goes_on_no_request_is_needed(capsys: pytest.CaptureFixture[str], verb: list[str]) -> None:
    assert main(["scene", *verb, "--profile", "studio"]) == 3
    told = capsys.readouterr().err
    assert AS_TOLD in told and "--request" not in told
    assert main(["scene", *verb, "--request", REQUEST, "--profile", "studio"]) == 2


@pytest.mark.parametrize("verb", ONE_CHANGE, ids=" ".join)
@pytest.mark.parametrize("request_text", ["what?", ID, f"{ID}@", f"{ID}@0", f"{ID}@-1", "0f@17", f"{ID}00@17"])
def test_what_is_no_request_is_wrong_usage_in_one_line(capsys: pytest.CaptureFixture[str], verb: list[str], request_text: str) -> None:
    assert main([*verb, "--request", request_text, "--profile", "studio"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: Invalid value for --request: ") and told.count("\n") == 1 and "as the error names it" in told


@pytest.mark.parametrize("verb", NO_CHANGE, ids=" ".join)
def test_where_nothing_is_changed_there_is_nothing_to_repeat(capsys: pytest.CaptureFixture[str], verb: list[str]) -> None:
    assert main([*verb, "--request", REQUEST, "--profile", "studio"]) == 2
    told = capsys.readouterr().err
    assert "nothing is to be changed" in told and told.count("\n") == 1
