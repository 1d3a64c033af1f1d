"""A locked file opens with its passphrase alone; a damaged one and a wrong passphrase are told apart."""

from __future__ import annotations

import os
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.crypto import passphrases
from scenefold.crypto.passphrases import WrongPassphrase, is_locked, lock, unlock

PASSPHRASE = "correct horse battery"
SLOW = passphrases.LOG2_N


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passphrases, "LOG2_N", 4)


@pytest.fixture
def locked(quick: None) -> bytes:
    return lock(b"the secret", PASSPHRASE, os.urandom)


@given(st.binary(max_size=2000), st.text(min_size=8, max_size=40))
def test_it_opens_with_its_passphrase_and_no_other(data: bytes, passphrase: str) -> None:
    locked = lock(data, passphrase, os.urandom)
    assert is_locked(locked) and unlock(locked, passphrase) == data
    with pytest.raises(WrongPassphrase, match="the passphrase is wrong"):
        unlock(locked, passphrase + "x")


def test_what_people_get_is_slow_to_guess_and_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passphrases, "LOG2_N", SLOW)
    assert SLOW >= 17, "OWASP's least for scrypt with r = 8, p = 1"
    assert unlock(lock(b"secret", PASSPHRASE, os.urandom), PASSPHRASE) == b"secret"


def test_a_letter_may_be_typed_in_either_way() -> None:
    locked = lock(b"secret", "Schlüssel im Schloß", os.urandom)
    assert unlock(locked, "Schlu\u0308ssel im Schloß") == b"secret"


def test_every_damage_is_called_damage_and_opens_nothing(locked: bytes) -> None:
    for bit in range(8 * len(locked)):
        flipped = bytearray(locked)
        flipped[bit // 8] ^= 1 << bit % 8
        if bytes(flipped).split() == locked.split():
            continue  # A line that ends in another kind of blank says the same.
        with pytest.raises(LocalFault, match="damaged") as caught:
            unlock(bytes(flipped), PASSPHRASE, "key file")
        assert not isinstance(caught.value, WrongPassphrase) and caught.value.where == "key file"


@pytest.mark.parametrize("part", [0, 1, 31, 60, 100, -3, -30])
def test_a_file_that_was_cut_is_damaged(locked: bytes, part: int) -> None:
    with pytest.raises(LocalFault, match="damaged"):
        unlock(locked[:part], PASSPHRASE)


def test_blanks_at_the_ends_of_lines_do_no_harm(locked: bytes) -> None:
    assert unlock(locked.replace(b"\n", b" \r\n"), PASSPHRASE) == b"the secret"


@pytest.mark.parametrize("passphrase", ["", "short", "x" * 1025])
def test_a_passphrase_has_bounds(passphrase: str) -> None:
    with pytest.raises(UsageFault, match="8 to 1024 characters"):
        lock(b"secret", passphrase, os.urandom)


def test_what_is_no_locked_file_is_not_taken_for_one() -> None:
    random = Random(1)
    for _ in range(50):
        data = random.randbytes(random.randrange(200))
        assert not is_locked(data)
        with pytest.raises(LocalFault):
            unlock(data, PASSPHRASE)
