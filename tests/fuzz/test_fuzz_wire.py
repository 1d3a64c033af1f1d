"""If this fails, a stranger's bytes do something else than be taken or refused; a long run is in docs/how-to/fuzz.md."""

from __future__ import annotations

import pytest

from fuzz.fuzz_wire import Fuzzer, seeds
from fuzz.targets import TARGETS


@pytest.mark.parametrize("seed", [1, 2])
def test_a_short_run_finds_nothing(seed: int) -> None:
    fuzzer = Fuzzer(seed)
    for _ in range(4_000):
        fuzzer.step()
    assert fuzzer.tally.findings == []
    assert set(fuzzer.tally.inputs) == set(TARGETS)
    assert len(fuzzer.tally.outcomes) > 200


def test_the_good_ones_are_taken() -> None:
    fuzzer = Fuzzer(0)
    for name, good in seeds().items():
        for data in good:
            fuzzer.feed(name, data)
    assert fuzzer.tally.findings == []
    assert fuzzer.tally.accepted == fuzzer.tally.inputs


def test_what_breaks_a_law_is_written_down(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_data: bytes, _dice: object) -> str:
        raise IndexError("behind the end")

    monkeypatch.setitem(TARGETS, "packet", broken)
    fuzzer = Fuzzer(0)
    fuzzer.feed("packet", b"\x93")
    assert fuzzer.tally.findings == [{"target": "packet", "problem": "IndexError: behind the end", "bytes": "93"}]
