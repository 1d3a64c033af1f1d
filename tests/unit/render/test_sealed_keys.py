"""If this fails, a scene's keys open for a node that the client did not choose, or for another job, or not at all."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, PeerFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import DOCUMENT_BYTES_MAX, POOL_NODES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RENDER_PURPOSE, SealingKey
from scenefold.render.sealed_keys import NO_KEYS, About, SealedKeys, open_keys, seal_keys
from scenefold.scene.log import EpochKeys
from scenefold.wire import pack_value, unpack_value

ABOUT = About(b"c" * 16, b"g" * 32, 7)
ADA, BEN, EVE = NodeId(9), NodeId(2), NodeId(5)
KEYS = {node: SealingKey(bytes([node]) * 32) for node in (ADA, BEN, EVE)}
SCENE = EpochKeys({epoch: bytes([0x40 + epoch]) * 24 for epoch in range(3)})


token = random.Random(1).randbytes


def sealed(*nodes: NodeId, keys: EpochKeys = SCENE) -> SealedKeys:
    return seal_keys(keys, {node: KEYS[node].public for node in nodes}, ABOUT, token)


def test_whom_they_are_sealed_to_opens_all_of_them() -> None:
    found = sealed(ADA, BEN)
    assert found.nodes == {ADA, BEN}
    for node in (ADA, BEN):
        assert open_keys(found, node, KEYS[node], ABOUT) == SCENE


def test_nobody_else_is_refused_without_a_byte_of_them() -> None:
    found = sealed(ADA, BEN)
    with pytest.raises(Refused) as caught:
        open_keys(found, EVE, KEYS[EVE], ABOUT)
    assert caught.value.reason is RejectReason.NOT_AUTHORISED and "scenectl cluster trust" in caught.value.remedy
    for node in (ADA, BEN):
        with pytest.raises(DamagedData):
            open_keys(found, node, KEYS[EVE], ABOUT)
    moved = SealedKeys(((EVE, dict(found.boxes)[ADA]),), found.keys)
    for key in KEYS.values():
        with pytest.raises(DamagedData):
            open_keys(moved, EVE, key, ABOUT)


def test_no_key_of_the_scene_stands_in_what_travels() -> None:
    raw = pack_value(sealed(ADA, BEN).row())
    assert not any(key in raw or key[:8] in raw for key in SCENE.values())
    assert "40" * 4 not in repr(sealed(ADA))


@pytest.mark.parametrize("other", [replace(ABOUT, cluster=b"d" * 16), replace(ABOUT, genesis=b"h" * 32), replace(ABOUT, job=8)])
def test_for_another_job_scene_or_cluster_they_do_not_open(other: About) -> None:
    with pytest.raises(DamagedData):
        open_keys(sealed(ADA), ADA, KEYS[ADA], other)


def test_each_job_has_a_key_of_its_own() -> None:
    one, other = sealed(ADA), sealed(ADA)
    assert one.boxes != other.boxes and one.keys != other.keys
    with pytest.raises(DamagedData):
        open_keys(SealedKeys(one.boxes, other.keys), ADA, KEYS[ADA], ABOUT)


@given(st.integers(0, 10**6), st.integers(0, 7))
def test_one_flipped_bit_opens_nothing(place: int, bit: int) -> None:
    whole = seal_keys(SCENE, {ADA: KEYS[ADA].public}, ABOUT, token)
    ((_, box),) = whole.boxes
    raw = bytearray(box + whole.keys)
    raw[place % len(raw)] ^= 1 << bit
    damaged = SealedKeys(((ADA, bytes(raw[: len(box)])),), bytes(raw[len(box) :]))
    with pytest.raises(DamagedData):
        open_keys(damaged, ADA, KEYS[ADA], ABOUT)


@pytest.mark.parametrize(
    "inside", [b"", b"noise", pack_value({}), pack_value({"keys": []}), pack_value({"keys": [[0, b"short"]]}), pack_value([])]
)
def test_what_holds_no_keys_is_a_fault_of_who_sealed_it(inside: bytes) -> None:
    own = SealingKey(b"s" * 32)
    box = KEYS[ADA].public.seal(own.seed, RENDER_PURPOSE, ABOUT.context(ADA), token)
    keys = own.public.seal(inside, RENDER_PURPOSE, ABOUT.context(), token)
    with pytest.raises(PeerFault):
        open_keys(SealedKeys(((ADA, box),), keys), ADA, KEYS[ADA], ABOUT)
    short = KEYS[ADA].public.seal(b"no seed", RENDER_PURPOSE, ABOUT.context(ADA), token)
    with pytest.raises(PeerFault):
        open_keys(SealedKeys(((ADA, short),), keys), ADA, KEYS[ADA], ABOUT)


@given(st.dictionaries(st.integers(0, 2**32 - 1), st.binary(min_size=24, max_size=24), min_size=1, max_size=20))
def test_they_travel_as_plain_values(keys: dict[int, bytes]) -> None:
    found = sealed(EVE, ADA, BEN, keys=EpochKeys(keys))
    again = SealedKeys.of_row(unpack_value(pack_value(found.row())))
    assert again == found
    assert open_keys(again, EVE, KEYS[EVE], ABOUT) == EpochKeys(keys)
    assert SealedKeys.of_row(unpack_value(pack_value(NO_KEYS.row()))) == NO_KEYS


def test_the_largest_pool_with_keys_of_a_thousand_epochs_fits_a_packet() -> None:
    public = SealingKey(b"p" * 32).public
    many = EpochKeys({2**32 - 1 - epoch: bytes(24) for epoch in range(1000)})
    found = seal_keys(many, {NodeId(2**32 - 1 - node): public for node in range(POOL_NODES_MAX)}, ABOUT, token)
    assert len(pack_value(found.row())) < DOCUMENT_BYTES_MAX / 2
