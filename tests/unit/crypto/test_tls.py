"""If this fails, somebody without a certificate of this cluster can talk to its nodes, or pose as one."""

from __future__ import annotations

import datetime
import os
import ssl
import tempfile
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from scenefold.base.errors import LocalFault, PeerFault
from scenefold.crypto import Authority, Identity, client_context, peer_name, read_authority_certificate, server_context

ADDRESS = "127.0.0.2"
AUTHORITY = Authority.create("test")
NODE = AUTHORITY.issue("node:2130706434", [ADDRESS, "::1"])
USER = AUTHORITY.issue("user:ada", [])


def _advance(side: ssl.SSLObject) -> bool:
    """Whether the handshake is over for this side."""
    try:
        side.do_handshake()
    except ssl.SSLWantReadError:
        return False
    return True


def shake_hands(client: ssl.SSLContext, server: ssl.SSLContext, address: str = ADDRESS) -> tuple[ssl.SSLObject, ssl.SSLObject]:
    """Both ends in memory, until both are done; then one byte each way, since TLS 1.3 refuses a client only afterwards."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    near = client.wrap_bio(to_client, to_server, server_hostname=address)
    far = server.wrap_bio(to_server, to_client, server_side=True)
    waiting = [near, far]
    for _ in range(10):
        waiting = [side for side in waiting if not _advance(side)]
    assert not waiting, "the handshake does not end"
    for source, target in ((near, far), (far, near)):
        source.write(b"x")
        assert target.read(1) == b"x"
    return near, far


def test_both_sides_know_each_other() -> None:
    near, far = shake_hands(client_context(USER, AUTHORITY.certificate), server_context(NODE, AUTHORITY.certificate))
    assert (peer_name(near), peer_name(far)) == ("node:2130706434", "user:ada")
    assert near.version() == far.version() == "TLSv1.3"


def test_a_node_connects_too_and_by_any_of_its_addresses() -> None:
    other = AUTHORITY.issue("node:2130706435", ["127.0.0.3"])
    _, far = shake_hands(client_context(other, AUTHORITY.certificate), server_context(NODE, AUTHORITY.certificate), "::1")
    assert peer_name(far) == "node:2130706435"


def test_a_client_without_a_certificate() -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(cadata=AUTHORITY.certificate.decode())
    with pytest.raises(ssl.SSLError, match="PEER_DID_NOT_RETURN_A_CERTIFICATE"):
        shake_hands(context, server_context(NODE, AUTHORITY.certificate))


def test_a_client_of_a_foreign_authority() -> None:
    foreign = Authority.create("test")
    context = client_context(foreign.issue("user:ada", []), AUTHORITY.certificate)
    with pytest.raises(ssl.SSLError, match="CERTIFICATE_VERIFY_FAILED"):
        shake_hands(context, server_context(NODE, AUTHORITY.certificate))


def test_a_server_of_a_foreign_authority() -> None:
    foreign = Authority.create("test")
    context = server_context(foreign.issue("node:2130706434", [ADDRESS]), AUTHORITY.certificate)
    with pytest.raises(ssl.SSLCertVerificationError):
        shake_hands(client_context(USER, AUTHORITY.certificate), context)


def test_a_member_cannot_make_members() -> None:
    with pytest.raises(ssl.SSLError):
        shake_hands(client_context(USER, AUTHORITY.certificate), server_context(NODE, NODE.certificate))


def test_the_node_at_another_address() -> None:
    with pytest.raises(ssl.SSLCertVerificationError, match="IP address mismatch"):
        shake_hands(client_context(USER, AUTHORITY.certificate), server_context(NODE, AUTHORITY.certificate), "127.0.0.9")


def test_a_user_cannot_serve() -> None:
    user = AUTHORITY.issue("user:mallory", [ADDRESS])
    with pytest.raises(LocalFault, match="cannot accept"):
        server_context(user, AUTHORITY.certificate)
    # Nor by going round our own check: its certificate does not allow it.
    context = server_context(Identity("node:1", user.certificate, user.key), AUTHORITY.certificate)
    with pytest.raises(ssl.SSLCertVerificationError, match="purpose"):
        shake_hands(client_context(USER, AUTHORITY.certificate), context)


def test_nothing_older_than_tls_1_3() -> None:
    context = client_context(USER, AUTHORITY.certificate)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    with pytest.raises(ssl.SSLError):
        shake_hands(context, server_context(NODE, AUTHORITY.certificate))


@pytest.mark.parametrize(("days", "works"), [(-2, True), (0.9, True), (1.1, False), (-364.9, True), (-365.1, False)])
def test_validity(days: float, works: bool) -> None:
    """`days`: how far ahead the issuer's clock is of the one that checks."""
    now = datetime.datetime.now(datetime.UTC)
    node = AUTHORITY.issue("node:1", [ADDRESS], now=now + datetime.timedelta(days=days))
    contexts = client_context(USER, AUTHORITY.certificate), server_context(node, AUTHORITY.certificate)
    if works:
        shake_hands(*contexts)
    else:
        with pytest.raises(ssl.SSLCertVerificationError, match=r"expired|not yet valid"):
            shake_hands(*contexts)


def test_the_name_must_be_that_of_a_member() -> None:
    class Silent:
        def getpeercert(self) -> object:
            return None

    class Stranger:
        def getpeercert(self) -> object:
            return {"subject": ((("commonName", "www.example.org"),),)}

    for connection in (Silent(), Stranger()):
        with pytest.raises(PeerFault, match="names no member"):
            peer_name(connection)


@pytest.mark.parametrize(
    "name", ["", "node:", "node:a", "user:", "user:a b", "user:a\n", "admin:x", "node:12345678901", "user:" + "x" * 51]
)
def test_names_that_are_none(name: str) -> None:
    with pytest.raises(LocalFault, match="names no member"):
        AUTHORITY.issue(name, [])


def test_addresses_that_are_none() -> None:
    with pytest.raises(LocalFault, match="no IP address"):
        AUTHORITY.issue("node:1", ["localhost"])


def test_files(tmp_path: Path) -> None:
    AUTHORITY.to_files(tmp_path / "authority")
    NODE.to_files(tmp_path / "node")
    for path in tmp_path.rglob("*"):
        assert path.stat().st_mode & 0o777 == (0o700 if path.is_dir() else 0o600)
    authority, node = Authority.from_files(tmp_path / "authority"), Identity.from_files(tmp_path / "node")
    assert node == NODE
    assert authority.certificate == read_authority_certificate(tmp_path / "authority") == AUTHORITY.certificate
    shake_hands(client_context(authority.issue("user:new", []), AUTHORITY.certificate), server_context(node, authority.certificate))
    with pytest.raises(LocalFault, match="exists already"):
        Authority.create("other").to_files(tmp_path / "authority")


def test_damaged_files(tmp_path: Path) -> None:
    AUTHORITY.to_files(tmp_path)
    for name, problem in (("key.pem", "no private key"), ("certificate.pem", "no certificate")):
        path = tmp_path / name
        good = path.read_bytes()
        path.write_bytes(b"rubbish")
        for load in (Authority.from_files, Identity.from_files):
            with pytest.raises(LocalFault, match=problem):
                load(tmp_path)
        path.write_bytes(good)
    (tmp_path / "key.pem").write_bytes(NODE.key)
    with pytest.raises(LocalFault, match="does not belong"):
        Authority.from_files(tmp_path)
    (tmp_path / "key.pem").chmod(0o644)
    with pytest.raises(LocalFault, match="open to others"):
        Authority.from_files(tmp_path)
    (tmp_path / "certificate.pem").chmod(0o644)
    assert read_authority_certificate(tmp_path) == AUTHORITY.certificate


def test_unusable_identities() -> None:
    for identity in (
        Identity("node:1", b"", b""),
        Identity("node:1", NODE.certificate, USER.key),
        Identity("node:1", b"rubbish", NODE.key),
    ):
        with pytest.raises(LocalFault, match="unusable"):
            server_context(identity, AUTHORITY.certificate)
    for certificate in (b"", b"rubbish", b"\xff"):
        with pytest.raises(LocalFault, match="unusable"):
            client_context(USER, certificate)


def test_no_key_is_left_on_disk_or_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    opened = Path("/proc/self/fd")
    before = len(list(opened.iterdir())) if opened.exists() else 0
    client_context(USER, AUTHORITY.certificate)
    assert list(tmp_path.iterdir()) == []
    assert (len(list(opened.iterdir())) if opened.exists() else 0) == before


def test_a_key_is_not_shown() -> None:
    assert b"PRIVATE" not in repr(NODE).encode()


def test_without_memory_files_no_key_lies_in_a_temporary_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen, load = list[bytes](), ssl.SSLContext.load_cert_chain

    def watched(context: ssl.SSLContext, path: str, **named: Any) -> None:
        seen.append(Path(path).read_bytes())
        load(context, path, **named)

    monkeypatch.delattr(os, "memfd_create")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(ssl.SSLContext, "load_cert_chain", watched)
    near, _ = shake_hands(client_context(USER, AUTHORITY.certificate), server_context(NODE, AUTHORITY.certificate))
    assert peer_name(near) == NODE.name
    assert len(seen) == 2 and all(b"ENCRYPTED" in content and NODE.key not in content and USER.key not in content for content in seen)
    with pytest.raises(TypeError, match="encrypted"):
        load_pem_private_key(seen[0], password=None)
    assert list(tmp_path.iterdir()) == []
