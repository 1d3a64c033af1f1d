"""If this fails, a flipped bit or a lost end of a file in a profile ends in a traceback, in words about another file, or in nothing at all."""

from __future__ import annotations

import base64
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, ScenefoldError
from scenefold.client.births import born, kept_keys, maker_of
from scenefold.client.own_keys import own_keys
from scenefold.crypto import Authority, MemberSecrets, SealingKey, SecretFolder, client_context, passphrases, refuse_to_ask, server_context
from scenefold.crypto.suites import RSA3072
from scenefold.scene.log import Decider
from scenefold.world.keyring import Keyring
from scenefold.world.log_file import LogFile
from scenefold.world.own_papers import check_papers, opened_authority
from scenefold.world.profile import ClusterProfile
from scenefold.world.reissue import read_authority
from unit.world.test_log_view import RECORDS

ADDRESS, SCENE, PASSPHRASE = "127.0.0.2", "kitchen", "correct horse"
USER_FILES = ("certificate.pem", "key.pem", "signing.seed", "sealing.seed")
LOCKED = ("key.pem", "sealing.seed", "signing.seed")
PLACES = (
    "cluster.toml",
    "members.log",
    "authority/certificate.pem",
    "authority/key.pem",
    *(f"nodes/{ADDRESS}/{name}" for name in (*USER_FILES, "log.seed", "authority.sealed")),
    *(f"users/owner/{name}" for name in USER_FILES),
    f"scenes/{SCENE}.toml",
)

ANYWHERE = st.integers(0, 2**64 - 1)
"""Taken modulo what there is."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    profile = ClusterProfile.create(tmp_path_factory.mktemp("profiles") / "studio", "studio", [ADDRESS, "127.0.0.3"], trust_all=True)
    own = profile.user_secrets()
    origin = Decider(profile.voter.node_id, profile.voter.public_key.raw)
    profile.keyring.save(born(SCENE, maker_of("user:owner", own), own.signing, origin, secrets.token_bytes))
    LogFile(profile.folder).save(RECORDS)
    assert {*PLACES} == {name for name in _names(profile.folder) if "127.0.0.3" not in name}
    return profile.folder


@pytest.fixture(scope="module")
def whole(folder: Path) -> tuple[Any, ...]:
    return all_of(folder)


def _names(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file() and path.stat().st_size}


def all_of(folder: Path) -> tuple[Any, ...]:
    """What the programs read of a profile, in their order, and without what changes from one reading to the next."""
    profile = ClusterProfile.load(folder)
    identity, own = profile.user_identity(), profile.user_secrets()
    check_papers(profile, identity, own)
    client_context(identity, profile.authority_certificate())
    node, node_own = profile.node_identity(ADDRESS), profile.node_secrets(ADDRESS)
    check_papers(profile, node, node_own)
    server_context(node, profile.authority_certificate())
    log_key, sealed = profile.log_signing_key(ADDRESS), opened_authority(profile, ADDRESS, node_own)
    assert log_key is not None and sealed is not None
    kept = Keyring(folder / "scenes").load(SCENE)
    # Of sealing keys what they open: X25519 does not look at all bits.
    return (
        *(profile, profile.facts(), own_keys(folder, None, refuse_to_ask).document(), kept, repr(kept_keys(kept, own.sealing))),
        *(identity.key, node.key),
        *(secret.secret for secret in (own.signing, node_own.signing, log_key)),
        *(profile.authority().key_der(), sealed.key_der(), read_authority(profile).key_der(), LogFile(folder).load()[1]),
    )


@contextmanager
def spoilt(path: Path, content: bytes) -> Iterator[None]:
    whole = path.read_bytes()
    path.write_bytes(content)
    try:
        yield
    finally:
        path.write_bytes(whole)


def check_told(folder: Path, place: str, content: bytes, whole: tuple[Any, ...]) -> None:
    """Reading all either names the file and says what to do, or gives what it gave: an end of a line more or less is no damage."""
    with spoilt(folder / place, content):
        found, problem = told_by(lambda: all_of(folder))
    if problem is None:
        is_same = found == whole
        assert is_same, f"{place} says something else, and nobody is told"
    else:
        name, where = Path(place), problem.where or ""
        assert str(folder / name.parent) in where and name.name in where, f"{problem}, and {place} is damaged"
        assert problem.remedy, f"{problem}: and what now?"


def told_by(read: Callable[[], Any]) -> tuple[Any, ScenefoldError | None]:
    """What is read, or what is told instead."""
    try:
        return read(), None
    except ScenefoldError as problem:
        return None, problem


def flipped(content: bytes, at: int) -> bytes:
    bit = at % (8 * len(content))
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_a_whole_profile_is_read_twice_alike(folder: Path, whole: tuple[Any, ...]) -> None:
    assert all_of(folder) == whole


@settings(max_examples=300)
@given(st.sampled_from(PLACES), ANYWHERE)
def test_a_flipped_bit_is_told_of_its_file(folder: Path, whole: tuple[Any, ...], place: str, at: int) -> None:
    content = (folder / place).read_bytes()
    check_told(folder, place, flipped(content, at), whole)


@pytest.mark.parametrize("place", [f"nodes/{ADDRESS}/certificate.pem", "authority/certificate.pem"])
def test_a_serial_number_below_zero_is_told_of(folder: Path, whole: tuple[Any, ...], place: str) -> None:
    """Its sign is one bit, of which the library only warns."""
    der = bytearray(x509.load_pem_x509_certificate((folder / place).read_bytes()).public_bytes(Encoding.DER))
    serial = x509.load_der_x509_certificate(bytes(der)).serial_number
    digits = serial.to_bytes(serial.bit_length() // 8 + 1, "big")
    der[der.index(digits)] |= 0x80
    pem = b"-----BEGIN CERTIFICATE-----\n" + base64.encodebytes(bytes(der)) + b"-----END CERTIFICATE-----\n"
    check_told(folder, place, pem, whole)


@settings(max_examples=100)
@given(st.sampled_from(PLACES), ANYWHERE)
def test_a_file_that_lost_its_end_is_told_of(folder: Path, whole: tuple[Any, ...], place: str, at: int) -> None:
    content = (folder / place).read_bytes()
    check_told(folder, place, content[: at % len(content)], whole)


@pytest.mark.parametrize("place", PLACES)
def test_an_empty_file_is_told_of(folder: Path, place: str) -> None:
    with spoilt(folder / place, b""), pytest.raises(ScenefoldError):
        all_of(folder)


@pytest.mark.parametrize("place", ["cluster.toml", f"scenes/{SCENE}.toml"])
def test_no_bit_of_a_document_changes_what_it_says(folder: Path, place: str) -> None:
    """Ports, seeds and positions have no key that they would belong to: a digest guards them."""
    content = (folder / place).read_bytes()
    for bit in range(8 * content.index(b"\n"), 8 * len(content), 97):
        with spoilt(folder / place, flipped(content, bit)), pytest.raises(LocalFault, match="damaged"):
            ClusterProfile.load(folder).keyring.load(SCENE)


def test_a_document_without_its_digest_is_read(folder: Path, whole: tuple[Any, ...]) -> None:
    content = (folder / "cluster.toml").read_bytes()
    with spoilt(folder / "cluster.toml", content.partition(b"\n")[2]):
        assert all_of(folder) == whole


@settings(max_examples=100)
@given(ANYWHERE, st.booleans())
def test_locked_keys_that_are_damaged_are_told_of(locked: Path, at: int, is_cut: bool) -> None:
    content = locked.read_bytes()
    with spoilt(locked, content[: at % len(content)] if is_cut else flipped(content, at)):
        names, problem = told_by(SecretFolder(locked.parent, lambda _: PASSPHRASE).names)
    if problem is None:
        assert names == LOCKED
    else:
        assert problem.where == str(locked) and problem.remedy and "damaged" in problem.what


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("locked")
    Authority.create("studio").issue("user:owner", []).to_files(folder)
    MemberSecrets.generate().to_files(folder)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(passphrases, "LOG2_N", 4)
        SecretFolder(folder).lock(LOCKED, PASSPHRASE, secrets.token_bytes)
    return folder / "locked"


@settings(max_examples=40)
@given(ANYWHERE)
def test_damaged_keys_of_rsa_are_told_of(rsa: Path, at: int) -> None:
    """Those of which nothing is told are other keys, which no certificate names, or the same."""
    content = (rsa / "sealing.pem").read_bytes()
    with spoilt(rsa / "sealing.pem", flipped(content, at)):
        _, problem = told_by(lambda: SealingKey.from_file(rsa / "sealing.pem"))
    assert problem is None or (problem.where == str(rsa / "sealing.pem") and problem.remedy)


@pytest.fixture(scope="module")
def rsa(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rsa")
    SealingKey.generate(RSA3072).to_file(folder / "sealing.pem")
    return folder
