"""If this fails, records of former epochs cannot be read by those who may, or the keys to them by anybody."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.limits import FORMER_KEYS_BYTES_MAX, FORMER_KEYS_MAX
from scenefold.crypto import open_former, seal_former

KEY, GENESIS, NONCE = b"k" * 24, b"g" * 32, b"n" * 12


@given(st.integers(1, 300))
def test_the_newest_of_them_are_found_again(epoch: int) -> None:
    keys = {number: number.to_bytes(24, "big") for number in range(epoch)}
    sealed = seal_former(keys, genesis=GENESIS, key_epoch=epoch, symmetric_key=KEY, nonce=NONCE)
    assert len(sealed) <= FORMER_KEYS_BYTES_MAX
    opened = open_former(sealed, genesis=GENESIS, key_epoch=epoch, symmetric_key=KEY)
    assert opened == {number: key for number, key in keys.items() if number >= epoch - FORMER_KEYS_MAX}


@given(st.data())
def test_they_open_for_their_scene_epoch_and_key_only(data: st.DataObject) -> None:
    sealed = seal_former({0: bytes(24)}, genesis=GENESIS, key_epoch=1, symmetric_key=KEY, nonce=NONCE)
    for other in ({"genesis": bytes(32)}, {"key_epoch": 2}, {"symmetric_key": bytes(24)}):
        with pytest.raises(DamagedData):
            open_former(sealed, **{"genesis": GENESIS, "key_epoch": 1, "symmetric_key": KEY, **other})  # type: ignore[arg-type]
    flipped = bytearray(sealed)
    flipped[data.draw(st.integers(0, len(sealed) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    for broken in (bytes(flipped), sealed[: data.draw(st.integers(0, len(sealed) - 1))]):
        with pytest.raises(DamagedData):
            open_former(broken, genesis=GENESIS, key_epoch=1, symmetric_key=KEY)
