"""If this failed, an older record could replace a newer one, or an import could overwrite another atom."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, EXPECTS_NOTHING, RecordHeader, version_key
from scenefold.store import Outcome, PutResult
from scenefold.store.judging import judge, judge_copy
from unit.store.samples import NOWHERE, record

OLD = record(1, seq=1, text=b"old").header
NEW = record(1, seq=2, text=b"new").header


@pytest.mark.parametrize(
    ("new", "expects", "present", "outcome"),
    [
        (NEW, EXPECTS_ANYTHING, None, Outcome.STORED),
        (NEW, EXPECTS_NOTHING, None, Outcome.STORED),
        (NEW, OLD.digest, None, Outcome.EXISTS),
        (NEW, EXPECTS_ANYTHING, OLD, Outcome.STORED),
        (NEW, OLD.digest, OLD, Outcome.STORED),
        (NEW, EXPECTS_NOTHING, OLD, Outcome.EXISTS),
        (NEW, NOWHERE, OLD, Outcome.EXISTS),
        (OLD, EXPECTS_ANYTHING, NEW, Outcome.STALE),
        (OLD, NEW.digest, NEW, Outcome.STALE),
        # Another record of the same bytes, and version, that expects something else.
        (NEW, EXPECTS_NOTHING, NEW, Outcome.EXISTS),
        (NEW, NEW.digest, NEW, Outcome.STALE),
    ],
)
def test_table(new: RecordHeader, expects: bytes, present: RecordHeader | None, outcome: Outcome) -> None:
    new = new._replace(expects=expects)
    assert judge(new, present).outcome is outcome
    assert judge(new, new).outcome is Outcome.STORED, "a repetition, whatever it expects"
    newer = present is None or version_key(new) > version_key(present)
    assert judge_copy(new, present).outcome is (Outcome.STORED if newer else Outcome.STALE), "of a copy only the version counts"


def test_a_refusal_tells_what_is_there() -> None:
    assert judge(NEW._replace(expects=EXPECTS_NOTHING), OLD) == PutResult(Outcome.EXISTS, OLD.digest)
    assert judge(NEW._replace(expects=OLD.digest), None) == PutResult(Outcome.EXISTS, b"")
    assert judge(OLD, NEW).reason is RejectReason.STALE_VERSION
    assert judge(NEW, OLD).reason is None


@given(st.lists(st.tuples(st.integers(0, 3), st.binary(max_size=2)), min_size=1, max_size=4, unique=True))
def test_the_same_record_wins_in_every_order_of_arrival(versions: list[tuple[int, bytes]]) -> None:
    headers = [record(1, seq=seq, text=text).header for seq, text in versions]
    winners = set()
    for order in itertools.permutations(headers):
        present = None
        for header in order:
            if judge(header, present).outcome is Outcome.STORED:
                present = header
        assert present is not None
        winners.add(present.digest + present.seq.to_bytes(8, "big"))
    assert len(winners) == 1
