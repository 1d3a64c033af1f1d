"""If this fails, a lockbox tells what is in it, or opens for somebody else, or gives what is no key."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.crypto import SealingKey, SigningKey
from scenefold.scene.log import Contents, locked, unlocked
from scenefold.wire import KeyEntry, Role
from unit.scene.log.members import secrets_of
from unit.scene.log.test_grants import MAKER_NUMBER, Story

SIGNER = secrets_of(MAKER_NUMBER).signing
CONTENTS = Contents(Role.OWNER, 3, bytes(24), SigningKey(b"h" * 32).public, "kitchen", "user:owner", b"h" * 32)


def test_lockboxes_are_alike_from_outside() -> None:
    reader = replace(CONTENTS, role=Role.READER, header_seed=None, name="k")
    recipient = KeyEntry(1, SealingKey(bytes(32)).public.raw)
    one, other = (locked(contents, recipient, bytes(32), SIGNER, Story().token) for contents in (CONTENTS, reader))
    assert len(one.sealed) == len(other.sealed)


@given(st.data())
def test_a_lockbox_opens_for_its_member_scene_and_epoch_only(data: st.DataObject) -> None:
    key = SealingKey(bytes(31) + b"\x05")
    lockbox = locked(CONTENTS, KeyEntry(1, key.public.raw), b"g" * 32, SIGNER, Story().token)
    assert unlocked(lockbox, key, b"g" * 32, 3) == CONTENTS
    for other in ((SealingKey(bytes(32)), b"g" * 32, 3), (key, b"h" * 32, 3), (key, b"g" * 32, 2)):
        with pytest.raises(DamagedData):
            unlocked(lockbox, *other)
    at, bit = data.draw(st.integers(0, len(lockbox.sealed) - 1)), data.draw(st.integers(0, 7))
    flipped = bytearray(lockbox.sealed)
    flipped[at] ^= 1 << bit
    with pytest.raises(DamagedData):
        unlocked(replace(lockbox, sealed=bytes(flipped)), key, b"g" * 32, 3)


@given(st.binary(max_size=200))
def test_whatever_a_lockbox_holds_is_keys_or_damaged(plain: bytes) -> None:
    with pytest.raises(DamagedData):
        Contents.decode(plain)


@pytest.mark.parametrize("name", ["\x1b[2Jkitchen", "kitchen\n", "\u202enehctik"])
def test_a_name_that_would_steer_a_terminal_is_none(name: str) -> None:
    for changed in (replace(CONTENTS, name=name), replace(CONTENTS, granter=name)):
        with pytest.raises(DamagedData, match="cannot be shown"):
            Contents.decode(changed.encode())


@given(st.data())
def test_changed_contents_are_other_keys_or_damaged(data: st.DataObject) -> None:
    encoded = bytearray(CONTENTS.encode())
    encoded[data.draw(st.integers(0, len(encoded) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        found = Contents.decode(bytes(encoded))
    except DamagedData:
        return
    assert found.encode() == bytes(encoded) != CONTENTS.encode()
