"""If this fails, people are told that something went that did not, or not told what to do about what waits."""

from __future__ import annotations

from scenectl.purging import _kept_apart, _purged
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client.purge_walk import Purge
from scenefold.client.suspects import Suspect, SuspectReport

PLACE = Location.from_number(7 << 150)


def test_a_purge_that_had_all_its_way_says_only_that() -> None:
    report = Purge(0.0, walked=40, deleted=12, can_go=12, purged=12, seconds=3.0)
    assert _purged("kitchen", report) == "kitchen: 12 deletions among 40 records, gone: 12, 3.0 s."


def test_what_stays_is_told_with_why() -> None:
    report = Purge(
        0.0, walked=40, deleted=12, can_go=9, purged=5, kept=3, overtaken=1, waiting=2, not_begun=1, reasons=["127.0.0.4 is away"]
    )
    text = _purged("kitchen", report)
    assert "3 stay as long as records lie right behind them." in text and "At 1 places somebody has written meanwhile." in text
    assert "2 have to wait; the same command goes on:\n  127.0.0.4 is away" in text and "let an owner of the scene call this" in text


def test_a_dry_run_says_what_could_go() -> None:
    assert "could go: 9" in _purged("kitchen", Purge(0.0, is_dry=True, walked=40, deleted=12, can_go=9, kept=3))


def test_what_is_kept_apart_is_shown_with_who_keeps_it_and_what_to_do() -> None:
    assert _kept_apart("kitchen", SuspectReport()) == "Nothing of kitchen is kept apart."
    kinds = {"deletion": {"is_deletion": True}, "replaced": {"is_replaced": True}}
    for word, kind in kinds.items():
        stray = Suspect(SpaceId(2), PLACE, b"", ("127.0.0.4",), 3, 2048, **kind)
        assert word in _kept_apart("kitchen", SuspectReport(records=1, listed=[stray]))
    listed = [Suspect(SpaceId(2), PLACE, b"", ("127.0.0.4",), 3, 2048), Suspect(SpaceId(2), PLACE, b"o" * 16, ("127.0.0.5",), 3, None)]
    text = _kept_apart("kitchen", SuspectReport(records=3, listed=listed, unreadable=1, silent=["127.0.0.6"]))
    assert (
        "3 records are kept apart" in text and PLACE.hex() in text and "2.0 KiB" in text and "unreadable" in text and "and 1 more" in text
    )
    assert "No answer from 127.0.0.6" in text and "--restore" in text
    done = _kept_apart("kitchen", SuspectReport(records=3, listed=listed, restored=2, discarded=3))
    assert "2 were written anew, 3 are kept apart no more." in done and "--restore" not in done
