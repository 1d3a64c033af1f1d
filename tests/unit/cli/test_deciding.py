"""If this fails, scenectl lets other nodes decide than were meant, or says what became of a change by the wrong words or exit code."""

from __future__ import annotations

from typing import Any

import pytest

from scenectl import running
from scenectl.deciding import Participants, deciders_text, even_warning
from scenectl.errors import ending_of
from scenectl.program import main
from scenectl.standing import standing_text
from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Deciders, Request, Standing
from scenefold.wire import Member

A, B, C = (node_id_of(f"127.0.0.{number}") for number in (2, 3, 4))
REQUEST = "0f" * 16


def test_participants_are_a_number_or_nodes_or_the_origin() -> None:
    assert Participants.parse("3") == Participants(3)
    assert Participants.parse("0") == Participants.parse("origin") == Participants.parse(" ORIGIN ") == Participants(0)
    assert Participants.parse("127.0.0.2, 127.0.0.3") == Participants((A, B))
    assert [Participants.parse(text).count for text in ("5", "origin", "127.0.0.2")] == [5, 0, 1]
    assert str(Participants.parse("127.0.0.2,127.0.0.3")) == "127.0.0.2,127.0.0.3"
    for text in ("", "34", "-1", "1.5", "all", "127.0.0.2,127.0.0.2", "127.0.0.300", "node", "99999999999", "3,5"):
        with pytest.raises(ValueError):
            Participants.parse(text)


def test_an_even_number_is_warned_of() -> None:
    assert [bool(even_warning(count)) for count in range(8)] == [False, False, True, False, True, False, True, False]
    assert "both must agree, so none may be away" in even_warning(2)
    assert "4 nodes decide: 3 of the 4 must agree, so no more may be away than of 3" in even_warning(4)


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (Deciders(A, (), (), 4), "127.0.0.2 decides alone, as the node where scenes of this cluster begin."),
        (Deciders(A, (B,), (), 4), "127.0.0.3 decides alone."),
        (Deciders(A, (A, B, C), (), 4), "127.0.0.2, 127.0.0.3 and 127.0.0.4 decide; 2 of the 3 must agree."),
        (
            Deciders(A, (A, B, C), (), 4, lost=(B,)),
            "127.0.0.2, 127.0.0.3 and 127.0.0.4 decide; 2 of the 3 must agree.\n127.0.0.3 has lost its disk, and votes no more: "
            "none of the others may be away. `scenectl scene relieve 127.0.0.3` has another node decide in its place, in all scenes "
            "that you own; or remove-participant, and then add-participant.",
        ),
        (Deciders(A, (A,), (B,), 4), "127.0.0.2 decides alone.\nObservers: 127.0.0.3."),
        (Deciders(A, (A,), (), 4, changes_left=20), "127.0.0.2 decides alone."),
        *(
            (
                Deciders(A, (A,), (), 4, changes_left=left),
                f"127.0.0.2 decides alone.\nWho decides can change {times} in this scene's life; each node that is added or removed is one "
                "change. `scenectl scene export` and `scenectl scene import-archive` make a new scene of it, in which they can.",
            )
            for left, times in ((19, "19 more times"), (1, "once more"), (0, "no more"))
        ),
    ],
)
def test_who_decides_is_said_in_a_sentence(found: Deciders, text: str) -> None:
    assert deciders_text(found) == text
    document = found.document()
    assert document["by_origin_alone"] is (not found.participants) and len(document["decided_by"]) >= document["majority"]
    assert document["changes_left"] == found.changes_left


def test_a_request_is_read_as_errors_name_it() -> None:
    assert Request.parse(f"{REQUEST}@17") == Request(bytes.fromhex(REQUEST), 17)
    assert Request.parse(REQUEST.upper()) == Request(bytes.fromhex(REQUEST), 0)
    assert str(Request.parse(f"{REQUEST}@17")) == f"{REQUEST}@17" and str(Request.parse(REQUEST)) == REQUEST
    far = "18446744073709551616"
    for text in ("", "0f", f"{REQUEST}@", f"{REQUEST}@-1", f"{REQUEST}@x", f"{REQUEST}@{far}", f"{REQUEST}00", "g" * 32, "0" * 65_536):
        with pytest.raises(ValueError) as told:
            Request.parse(text)
        assert len(str(told.value)) < 300


@pytest.mark.parametrize(
    ("found", "code", "words", "outcome"),
    [
        (Standing(17, True, 19), 0, "at position 17", "committed"),
        (Standing(None, True, 19), 4, "never will be.*can be repeated", "never"),
        (Standing(None, False, 16), 3, "may still come, until something else is decided at position 17.*if it takes that", "open"),
    ],
)
def test_what_became_of_a_change_is_in_words_and_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], found: Standing, code: int, words: str, outcome: str
) -> None:
    import json
    import re

    def run(_work: Any) -> Standing:
        return found

    monkeypatch.setattr(running, "run", run)
    assert re.search(words, standing_text(found))
    assert main(["scene", "status", "kitchen", f"{REQUEST}@17", "--json", "--profile", "studio"]) == code
    document = json.loads(capsys.readouterr().out)
    assert (document["outcome"], document["known_position"], document["request"]) == (outcome, found.known, f"{REQUEST}@17")


@pytest.mark.parametrize("reason", [RejectReason.NO_MAJORITY, RejectReason.KEY_REVOKED, RejectReason.MODE_FORBIDS])
def test_who_refuses_to_answer_has_not_said_that_it_never_will_be(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], reason: RejectReason
) -> None:
    def run(_work: Any) -> None:
        raise ExceptionGroup("of a nursery", [Refused(reason, "not to you")])

    monkeypatch.setattr(running, "run", run)
    assert main(["scene", "status", "kitchen", REQUEST, "--profile", "studio"]) == 3
    assert "what became of the change was not told: not to you" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("reason", "code"),
    [
        (RejectReason.NO_MAJORITY, 4),
        (RejectReason.PEER_MISSED, 4),
        (RejectReason.NOT_AUTHORISED, 4),
        (RejectReason.MODE_FORBIDS, 4),
        (RejectReason.POSITION_TAKEN, 4),
        (RejectReason.BUSY, 3),
        (RejectReason.NOT_READY, 3),
    ],
)
def test_what_those_who_decide_refuse_has_its_exit_code(reason: RejectReason, code: int) -> None:
    assert ending_of(Refused(reason, "no")).exit_code == code


@pytest.mark.parametrize(
    "arguments",
    [
        ["create", "kitchen", "--participants", "3"],
        ["create", "kitchen", "--participants", "127.0.0.2,127.0.0.3"],
        ["participants", "kitchen"],
        ["add-participant", "kitchen", "127.0.0.2"],
        ["add-participant", "kitchen", "127.0.0.2", "127.0.0.3"],
        ["remove-participant", "kitchen", "127.0.0.2"],
        ["log", "kitchen", "--last", "5"],
    ],
)
def test_verbs_take_their_arguments(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    def run(_work: Any) -> None:
        raise Refused(RejectReason.NO_MAJORITY, "far enough")

    monkeypatch.setattr(running, "run", run)
    assert main(["scene", *arguments, "--profile", "studio"]) == 4
    assert "far enough" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ["create", "kitchen", "--participants", "34"],
        ["create", "kitchen", "--participants", "everybody"],
        ["add-participant", "kitchen"],
        ["add-participant", "kitchen", "nowhere"],
        ["remove-participant", "kitchen"],
        ["log", "kitchen", "--last", "0"],
        ["status", "kitchen", "what?"],
    ],
)
def test_wrong_usage_is_told_before_anything_is_asked(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    assert main(["scene", *arguments, "--profile", "studio"]) == 2
    assert "error: " in capsys.readouterr().err


def test_nodes_are_named_by_their_addresses() -> None:
    assert Participants.parse("127.0.0.2").wanted == (NodeId(A),)


def test_who_lives_on_as_another_one_votes_no_more() -> None:
    members = tuple(Member(node, bytes(16)) for node in (A, B, C))
    found = Deciders(A, (A, B, C), (), 4, members)
    assert "lost" not in found.document() and found.judged(dict.fromkeys((A, B, C), bytes(16))).document()["lost"] == []
    assert found.judged({A: bytes(16), B: b"another life 123"}).lost == (B, C)
    assert "too few are left" in deciders_text(found.judged({}))
