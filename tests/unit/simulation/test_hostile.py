"""If this fails, liars in the simulation tell no lies, or the network forgets what to play again, or a lie breaks more than it may."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import pytest

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordHeader, SigningKey, seal_record
from scenefold.peer.membership.proofs import Proofs
from scenefold.simulation import laws
from scenefold.simulation.cluster import Node
from scenefold.simulation.faults import Kind
from scenefold.simulation.liar import WAYS, Liar, MadeUp, flipped, place_of_record
from scenefold.simulation.lies import Lies, Way
from scenefold.simulation.outcome import Order, Result
from scenefold.simulation.recording import Recorder
from scenefold.simulation.run import run
from scenefold.store import Outcome, PutResult, record_changes
from scenefold.store.judging import judge, judge_copy
from scenefold.wire import PutItem, RecordBytes

KEY = SigningKey.from_seed(bytes(32))
VOUCHING_SEEDS = 20
"""A lie about who hears whom comes to something in one of some five."""


@pytest.mark.parametrize("size", [1, 16, 1400])
def test_one_bit_is_turned_over(size: int) -> None:
    dice, data = random.Random(size), bytes(size)
    for _ in range(100):
        assert sum(byte.bit_count() for byte in flipped(data, dice)) == 1


class LyingNode:
    """As much of a node as its liar looks at while it makes something up."""

    slot = 0
    secrets = SimpleNamespace(signing=KEY)


@pytest.mark.parametrize("keys", [{}, {0: bytes(24)}], ids=["without the key", "with the key"])
def test_what_is_left_of_a_record_is_falsified_as_well_as_a_whole_one(keys: dict[int, bytes]) -> None:
    node = cast(Node, LyingNode())
    liar = Liar(node, Lies(lambda: 0, lambda _who, _where, _what: None), MadeUp(), lambda: keys, lambda: None, seed=0)
    whole = seal_record(
        b"payload",
        scene=SceneId(1),
        genesis=bytes(32),
        space=SpaceId(1),
        location=Location.from_number(5),
        epoch=1,
        seq=1,
        session=1,
        nonce=bytes(12),
        symmetric_key=bytes(24),
        signing_key=KEY,
    )
    for record in (RecordBytes(whole.signature, whole.header_bytes, part) for part in (whole.ciphertext, b"")):
        for how in range(WAYS):
            assert liar.wrong(place_of_record(record), record, how) != record


def test_lies_are_told_and_datagrams_played_again_and_nothing_breaks() -> None:
    seen = Counter[str]()
    for seed in range(2):
        outcome = run(Order(seed, kinds=(Kind.LIAR, Kind.REPLAY), storm_s=20.0))
        assert not outcome.violations
        seen.update(outcome.counts)
        seen.update(outcome.faults)
    assert seen["lies"] > 0 and seen["lying node"] > 1 and seen["replayed datagrams"] > 1


def refused_once(monkeypatch: pytest.MonkeyPatch) -> Counter[int | None]:
    """What liars are answered to writes that were refused before."""
    heard, written = Counter[int | None](), Recorder.written

    def look(self: Recorder, way: Way, begin: int, items: Sequence[PutItem], outcomes: Sequence[int] | None) -> None:
        if way.to.startswith("node:"):
            heard[None if outcomes is None else outcomes[0]] += 1
        written(self, way, begin, items, outcomes)

    monkeypatch.setattr(Recorder, "written", look)
    return heard


def lying(seed: int) -> Result:
    return run(Order(seed, kinds=(Kind.LIAR,), storm_s=20.0))


def test_a_liar_offers_again_what_was_refused_and_it_is_refused_again(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = refused_once(monkeypatch)
    for seed in range(2):
        assert not lying(seed).violations
    assert heard[RejectReason.STALE_VERSION] > 5


def test_that_a_node_takes_what_it_has_refused_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if whoever offers it again could leave out what it expects."""
    seen: set[bytes] = set()

    def forgetful(new: RecordHeader, present: RecordHeader | None) -> PutResult:
        result = judge(new, present)
        if result.outcome is Outcome.EXISTS and new.digest in seen:
            return judge_copy(new, present)
        seen.add(new.digest)
        return result

    monkeypatch.setattr(record_changes, "judge", forgetful)
    found = {violation.law for seed in range(2) for violation in lying(seed).violations}
    assert laws.LINEARIZABLE in found


def test_that_a_node_is_believed_which_vouches_for_whom_it_likes_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def laws_broken(seed: int) -> set[str]:
        return {violation.law for violation in run(Order(seed, kinds=(Kind.LIAR, Kind.CRASH, Kind.ONE_WAY), storm_s=40.0)).violations}

    with monkeypatch.context() as believing:
        believing.setattr(Proofs, "is_right", lambda *_args: True)
        noticed = next((seed for seed in range(VOUCHING_SEEDS) if laws.VERIFIED in laws_broken(seed)), None)
    assert noticed is not None
    assert not laws_broken(noticed), "and the product holds there"
