"""If this failed, an older record could replace a newer one, or an import could overwrite another atom."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.reasons import RejectReason
from scenefold.store import Outcome, PutResult
from scenefold.store.judging import judge
from unit.store.samples import record

OLD = record(1, seq=1, text=b"old").header
NEW = record(1, seq=2, text=b"new").header


@pytest.mark.parametrize(
    ("new", "expect", "present", "outcome"),
    [
        (NEW, None, None, Outcome.STORED),
        (NEW, b"", None, Outcome.STORED),
        (NEW, OLD.digest, None, Outcome.EXISTS),
        (NEW, None, OLD, Outcome.STORED),
        (NEW, OLD.digest, OLD, Outcome.STORED),
        (NEW, b"", OLD, Outcome.EXISTS),
        (NEW, bytes(32), OLD, Outcome.EXISTS),
        (OLD, None, NEW, Outcome.STALE),
        (OLD, NEW.digest, NEW, Outcome.STALE),
        (NEW, b"", NEW, Outcome.STORED),
        (NEW, OLD.digest, NEW, Outcome.STORED),
    ],
)
def test_table(new: object, expect: bytes | None, present: object, outcome: Outcome) -> None:
    assert judge(new, expect, present).outcome is outcome  # type: ignore[arg-type]


def test_a_refusal_tells_what_is_there() -> None:
    assert judge(NEW, b"", OLD) == PutResult(Outcome.EXISTS, OLD.digest)
    assert judge(NEW, OLD.digest, None) == PutResult(Outcome.EXISTS, b"")
    assert judge(OLD, None, NEW).reason is RejectReason.STALE_VERSION
    assert judge(NEW, None, OLD).reason is None


@given(st.lists(st.tuples(st.integers(0, 3), st.binary(max_size=2)), min_size=1, max_size=4, unique=True))
def test_the_same_record_wins_in_every_order_of_arrival(versions: list[tuple[int, bytes]]) -> None:
    headers = [record(1, seq=seq, text=text).header for seq, text in versions]
    winners = set()
    for order in itertools.permutations(headers):
        present = None
        for header in order:
            if judge(header, None, present).outcome is Outcome.STORED:
                present = header
        assert present is not None
        winners.add(present.digest + present.seq.to_bytes(8, "big"))
    assert len(winners) == 1
