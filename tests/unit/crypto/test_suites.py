"""If this fails, keys of one suite pass for those of another, or an RSA key is weaker than the spec says."""

from __future__ import annotations

import re
import secrets
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from scenefold.base.errors import DamagedData, LocalFault, UsageFault
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import (
    AUTHORITY_PURPOSE,
    ED25519,
    HEADER_BYTES,
    LOCKBOX_PURPOSE,
    RECORD_DOMAIN,
    RSA3072,
    SUITE_NAMES,
    SUITES,
    IllFormedRecord,
    InvalidSignature,
    MemberKeys,
    MemberSecrets,
    PublicKey,
    Record,
    RecordHeader,
    SealingKey,
    SealingPublicKey,
    SigningKey,
    UnknownSuite,
    open_record,
    seal_record,
    suite_named,
    suite_of,
    verify_record,
)
from unit.crypto.suites_made import SEALING, SIGNING

SPEC = Path(__file__).resolve().parents[3] / "specs" / "04-records.md"
BOTH = pytest.mark.parametrize("suite", [ED25519, RSA3072])
KEY = b"k" * 24


def sealed(signer: SigningKey, payload: bytes = b"payload") -> Record:
    return seal_record(
        payload,
        scene=SceneId(7),
        genesis=b"g" * 32,
        space=SpaceId(2),
        location=Location.from_number(1 << 150),
        epoch=3,
        seq=4,
        session=5,
        nonce=b"n" * 12,
        symmetric_key=KEY,
        signing_key=signer,
    )


def test_the_registry_is_that_of_the_spec() -> None:
    rows = re.findall(r"^\| (\d+) \| `([a-z0-9-]+)` \| .*?(\d+) bytes \| (\d+) bytes", SPEC.read_text(encoding="utf-8"), re.MULTILINE)
    assert [(int(number), name, int(sizes), int(keys)) for number, name, sizes, keys in rows] == [
        (suite.number, suite.name, suite.signature_bytes, suite.public_key_bytes) for suite in SUITES.values()
    ]
    assert [suite_named(name).number for name in SUITE_NAMES] == list(SUITES)
    with pytest.raises(UsageFault, match="choose of ed25519-aes192gcm, rsa3072-aes192gcm"):
        suite_named("rsa512")
    for number in (0, 3, 255):
        with pytest.raises(UnknownSuite, match=f"suite {number} is unknown"):
            suite_of(number)


@BOTH
def test_signatures_are_as_long_as_the_suite_says_and_mean_one_thing(suite: int) -> None:
    key = SIGNING[suite]
    signature = key.sign(RECORD_DOMAIN, b"message")
    assert len(signature) == SUITES[suite].signature_bytes == key.public.signature_bytes
    PublicKey(key.public.raw, suite).verify(signature, RECORD_DOMAIN, b"message")
    wrong = [
        (signature, b"scenefold/header", b"message"),
        (signature, RECORD_DOMAIN, b"messagE"),
        (signature[:-1], RECORD_DOMAIN, b"message"),
        (signature + b"\0", RECORD_DOMAIN, b"message"),
        (b"", RECORD_DOMAIN, b"message"),
        (bytes(len(signature)), RECORD_DOMAIN, b"message"),
        (b"\xff" * len(signature), RECORD_DOMAIN, b"message"),
    ]
    for claim in wrong:
        with pytest.raises(InvalidSignature):
            key.public.verify(*claim)


def test_an_rsa_signature_has_a_salt_so_no_two_are_alike() -> None:
    key = SIGNING[RSA3072]
    assert key.sign(RECORD_DOMAIN, b"") != key.sign(RECORD_DOMAIN, b"")


@BOTH
def test_records_of_each_suite_go_round(suite: int) -> None:
    record = sealed(SIGNING[suite])
    assert len(record.encode()) == HEADER_BYTES + SUITES[suite].signature_bytes + len(b"payload") + 16
    again = Record.decode(record.encode())
    assert again == record and verify_record(again, SIGNING[suite].public).suite == suite
    assert open_record(again, KEY) == b"payload"


@BOTH
def test_a_record_of_another_suite_than_its_writers_is_refused(suite: int) -> None:
    other = ED25519 + RSA3072 - suite
    record = sealed(SIGNING[suite])
    header = record.header._replace(suite=other).encode()
    bent = Record(header, SIGNING[suite].sign(RECORD_DOMAIN, header), record.ciphertext)
    with pytest.raises(InvalidSignature, match=f"a record of suite {other} by a key of suite {suite}"):
        verify_record(bent, SIGNING[suite].public)
    with pytest.raises(IllFormedRecord, match="were expected"):
        Record.decode(bent.encode())


@pytest.mark.parametrize("number", [0, 3, 255])
def test_a_record_of_an_unknown_suite_is_ill_formed(number: int) -> None:
    record = sealed(SIGNING[ED25519])
    with pytest.raises(IllFormedRecord, match=f"suite {number}"):
        RecordHeader.decode(record.header_bytes[:1] + bytes((number,)) + record.header_bytes[2:])


def modulus(number: int, size: int = 384) -> bytes:
    return number.to_bytes(size, "big")


@pytest.mark.parametrize(
    "raw",
    [b"", bytes(32), bytes(384), modulus((1 << 3071) + 2), modulus((1 << 3071) - 1), modulus((1 << 3072) + 1, 385), b"\xff" * 383],
    ids=["empty", "short", "zero", "even", "small", "long", "a byte less"],
)
def test_what_is_no_rsa_modulus_is_damaged(raw: bytes) -> None:
    for kind in (PublicKey, SealingPublicKey):
        with pytest.raises(DamagedData):
            kind(raw, RSA3072)


def test_a_key_of_a_suite_that_nobody_knows() -> None:
    for kind in (PublicKey, SealingPublicKey):
        with pytest.raises(UnknownSuite, match="update this program"):
            kind(bytes(32), 3)


def other_rsa(bits: int, exponent: int) -> bytes:
    return rsa.generate_private_key(exponent, bits).private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


@pytest.mark.parametrize("bits, exponent", [(2048, 65537), (3072, 3)])
def test_rsa_keys_of_another_size_or_exponent_are_not_ours(bits: int, exponent: int) -> None:
    pem = other_rsa(bits, exponent)
    for kind in (SigningKey, SealingKey):
        with pytest.raises(LocalFault, match="not RSA with 3072 bits and exponent 65537"):
            kind(pem, RSA3072)
        with pytest.raises(LocalFault, match="holds no"):
            kind.from_text(pem, "somewhere")


@BOTH
def test_what_is_sealed_opens_for_its_key_purpose_and_context_alone(suite: int) -> None:
    key = SEALING[suite]
    box = key.public.seal(b"scene key", LOCKBOX_PURPOSE, b"context", secrets.token_bytes)
    assert SealingPublicKey(key.public.raw, suite) == key.public
    assert key.open(box, LOCKBOX_PURPOSE, b"context") == b"scene key"
    wrong = [(box, AUTHORITY_PURPOSE, b"context"), (box, LOCKBOX_PURPOSE, b"other"), (box[:-1], LOCKBOX_PURPOSE, b"context")]
    wrong += [(box + b"\0", LOCKBOX_PURPOSE, b"context"), (b"", LOCKBOX_PURPOSE, b"context")]
    # Each eighth bit: opening with RSA takes a millisecond, and every bit of an OAEP block does the same.
    flips = [bytes(byte ^ (1 << at % 8) if index == at else byte for index, byte in enumerate(box)) for at in range(len(box))]
    for sealed_bytes, purpose, context in wrong + [(flip, LOCKBOX_PURPOSE, b"context") for flip in flips]:
        with pytest.raises(DamagedData, match="not sealed to this key"):
            key.open(sealed_bytes, purpose, context)


def test_only_so_much_is_sealed_to_an_rsa_key_and_it_agrees_on_nothing() -> None:
    key = SEALING[RSA3072]
    assert len(key.public.seal(bytes(318), LOCKBOX_PURPOSE, b"", secrets.token_bytes)) == 384
    with pytest.raises(LocalFault, match="at most 318"):
        key.public.seal(bytes(319), LOCKBOX_PURPOSE, b"", secrets.token_bytes)
    with pytest.raises(LocalFault, match="agree on no secret"):
        key.agree(SEALING[ED25519].public)
    with pytest.raises(LocalFault, match="agree on no secret"):
        SEALING[ED25519].agree(key.public)


@BOTH
def test_members_keys_of_each_suite_go_round(suite: int) -> None:
    keys = MemberKeys(SIGNING[suite].public, SEALING[ED25519 + RSA3072 - suite].public, is_administrator=True)
    assert MemberKeys.decode(keys.encode()) == keys


def test_one_key_does_not_do_both() -> None:
    raw = SIGNING[RSA3072].public.raw
    with pytest.raises(DamagedData, match="the one that is sealed to it"):
        MemberKeys(PublicKey(raw, RSA3072), SealingPublicKey(raw, RSA3072))


@BOTH
def test_a_members_secrets_survive_their_files(tmp_path: Path, suite: int) -> None:
    made = MemberSecrets(SIGNING[suite], SEALING[suite])
    made.to_files(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"{name}.{'seed' if suite == ED25519 else 'pem'}" for name in ("sealing", "signing")
    ]
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in tmp_path.iterdir())
    assert MemberSecrets.from_files(tmp_path).public() == made.public()
    for key in (made.signing, made.sealing):
        assert key.secret.hex() not in repr(key) and "PRIVATE" not in repr(key)


def test_secrets_of_both_forms_in_one_folder_are_refused(tmp_path: Path) -> None:
    for suite in (ED25519, RSA3072):
        MemberSecrets(SIGNING[suite], SEALING[suite]).to_files(tmp_path)
    with pytest.raises(LocalFault, match="two signing keys"):
        MemberSecrets.from_files(tmp_path)


def test_a_new_rsa_key_is_one() -> None:
    key = SigningKey.generate(RSA3072)
    key.public.verify(key.sign(RECORD_DOMAIN, b""), RECORD_DOMAIN, b"")
    assert key.public != SIGNING[RSA3072].public
