"""If this fails, who interrupts a change of a scene is told to make it twice, or nobody is told where in the log a change is."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenectl import running
from scenectl.errors import Interrupted
from scenectl.program import main
from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import SceneId, SpaceId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Access, Change, Deciders, Reencryption, Request
from scenefold.client.ending import SceneEnd
from scenefold.client.modes import ModeShown
from scenefold.client.render_settings import SettingsShown
from scenefold.scene.log import Affine, LoggedSpace
from scenefold.wire import RenderSettings, SceneMode
from unit.cli.test_repeating import ID, ONE_CHANGE, REQUEST

HALL = LoggedSpace(SpaceId(31), "hall", 1, "hilbert", (0.0,), (1.0,), Affine.identity(1), copies=1, copies_min=1)
DECIDERS = Deciders(node_id_of("127.0.0.2"), (), (), 19)
FOUND: dict[str, Any] = {
    "grant": Access((), 0, 19),
    "revoke": None,
    "rotate-key": Reencryption(1, 0.0, ended=True),
    "mode": ModeShown(19, SceneMode.RENDER, True),
    "settings": SettingsShown(19, RenderSettings()),
    "rm": SceneEnd(SceneId(7), 17),
    "add-participant": DECIDERS,
    "remove-participant": DECIDERS,
    "add-observer": DECIDERS,
    "remove-observer": DECIDERS,
    "create": (HALL, []),
    "translate": HALL,
    "scale": HALL,
    "copies": (HALL, []),
}
"""What each verb makes of it; the log has gone on to position 19."""
SAID_ELSEWHERE = ("mode", "rm")


def held_by(work: Any) -> Iterator[Any]:
    """What a function was made with."""
    yield from (cell.cell_contents for cell in getattr(work, "__closure__", None) or ())


def during(becomes: Callable[[Change], object], result: Any) -> Callable[..., Any]:
    """In place of `running.run`: this becomes of the change that is made."""

    def run(*works: Any) -> Any:
        held = [one for work in works for one in held_by(work)]
        (change,) = (one for one in held if isinstance(one, Change))
        becomes(change)
        if isinstance(result, BaseException):
            raise result
        for one in held:
            if isinstance(one, list) and not one:
                one.append(Access((), 1, 19))
        return result

    return run


def may_have_left(change: Change) -> None:
    change.request = Request(bytes.fromhex(ID), 17)


def stands(change: Change) -> None:
    change.stands(bytes.fromhex(ID), 17)


@pytest.mark.parametrize("struck", [Interrupted(15), KeyboardInterrupt()], ids=["SIGTERM", "Ctrl-C"])
@pytest.mark.parametrize("verb", ONE_CHANGE, ids=" ".join)
def test_whoever_is_interrupted_behind_an_offer_is_told_its_request(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str], struck: BaseException
) -> None:
    monkeypatch.setattr(running, "run", during(may_have_left, struck))
    assert main([*verb, "--json", "--profile", "studio"]) == 130
    told = capsys.readouterr()
    assert "interrupted: it is not known whether the change was made (scene kitchen)" in told.err
    assert (
        f"`scenectl scene status kitchen {REQUEST}` tells" in told.err
        and f"`--request {REQUEST}`: then it happens once at most" in told.err
    )
    assert "may be given again" not in told.err
    document = json.loads(told.out)
    assert (document["error"]["kind"], document["error"]["request"], document["exit_code"]) == ("interrupted", REQUEST, 130)


@pytest.mark.parametrize("struck", [Interrupted(15), KeyboardInterrupt()], ids=["SIGTERM", "Ctrl-C"])
@pytest.mark.parametrize("verb", ONE_CHANGE, ids=" ".join)
def test_whoever_is_interrupted_behind_the_answer_is_told_that_it_is_made(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str], struck: BaseException
) -> None:
    monkeypatch.setattr(running, "run", during(stands, struck))
    assert main([*verb, "--profile", "studio"]) == 130
    told = capsys.readouterr().err
    assert "at position 17 of " in told and "may be given again" not in told and "--request" not in told


@pytest.mark.parametrize("verb", ONE_CHANGE, ids=" ".join)
def test_before_anything_has_left_the_same_command_may_be_given_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    monkeypatch.setattr(running, "run", during(lambda _: None, Interrupted()))
    assert main([*verb, "--profile", "studio"]) == 130
    assert capsys.readouterr().err == "error: interrupted: the same command may be given again\n"


@pytest.mark.parametrize("verb", ONE_CHANGE, ids=" ".join)
def test_each_change_is_told_with_its_own_position(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    found = FOUND[verb[1]]
    monkeypatch.setattr(running, "run", during(stands, found))
    assert main([*verb, "--json", "--profile", "studio"]) == 0
    assert json.loads(capsys.readouterr().out)["position"] == 17
    monkeypatch.setattr(running, "run", during(stands, found))
    assert main([*verb, "--profile", "studio"]) == 0
    if verb[1] not in SAID_ELSEWHERE:
        assert capsys.readouterr().out.endswith("\nDecided at position 17 of the scene's log.\n")


@pytest.mark.parametrize("verb", [verb for verb in ONE_CHANGE if verb[1] in ("copies", "settings")], ids=" ".join)
def test_what_was_so_already_was_not_decided_now(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    monkeypatch.setattr(running, "run", during(lambda _: None, FOUND[verb[1]]))
    assert main([*verb, "--profile", "studio"]) == 0
    assert "Decided" not in capsys.readouterr().out


@pytest.mark.parametrize("verb", ONE_CHANGE, ids=" ".join)
def test_what_fails_behind_a_change_does_not_hide_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    monkeypatch.setattr(running, "run", during(stands, Refused(RejectReason.POSITION_BEHIND, "switched back")))
    assert main([*verb, "--profile", "studio"]) == 4
    told = capsys.readouterr().err
    assert "at position 17 of " in told and "switched back" in told


class Cluster:
    """It makes what it is asked for, and then nobody answers."""

    def __init__(self) -> None:
        self.scenes = SimpleNamespace(open=self._open)

    async def _open(self, _name: str) -> Any:
        return self

    async def create_space(self, _name: str, _box: object, *, again: Change, **_: object) -> Any:
        stands(again)
        return SimpleNamespace(made=HALL)

    async def space_named(self, _name: object) -> Any:
        return self

    async def set_copies(self, _copies: int, _least: int | None, *, again: Change) -> LoggedSpace:
        stands(again)
        return HALL

    async def shortages(self, _copies: int, _least: int) -> list[Any]:
        raise Unreachable("no node answers", where="127.0.0.2")

    async def __aenter__(self) -> Cluster:
        return self

    async def __aexit__(self, *_: object) -> None:
        return None


@pytest.mark.parametrize("verb", [verb for verb in ONE_CHANGE if verb[1] in ("create", "copies")], ids=" ".join)
def test_what_cannot_be_read_behind_a_change_is_a_warning(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    monkeypatch.setattr(running, "connected", lambda _profile: Cluster())
    assert main([*verb, "--json", "--profile", "studio"]) == 0
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert (document["name"], document["position"], document["shortages"]) == ("hall", 17, None)
    assert "warning: whether space hall can have all of its copies now is not known: no node answers (127.0.0.2)" in told.err


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_that_comes_while_an_offer_is_out_loses_no_request(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], number: signal.Signals
) -> None:
    class Silent(Cluster):
        async def set_copies(self, _copies: int, _least: int | None, *, again: Change) -> LoggedSpace:
            may_have_left(again)
            os.kill(os.getpid(), number)
            await trio.sleep_forever()

    monkeypatch.setattr(running, "connected", lambda _profile: Silent())
    assert main(["space", "copies", "hall", "2", "--scene", "kitchen", "--profile", "studio"]) == 130
    assert f"--request {REQUEST}`" in capsys.readouterr().err
