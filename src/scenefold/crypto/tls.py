"""TLS 1.3 with both sides authenticated by the cluster's authority (specs/04-records.md, Certificates).

The contexts are those of the standard library; `trio.SSLStream` takes them, with `server_hostname` the address
that was dialled, which the node's certificate must contain. A user's certificate cannot serve: OpenSSL checks
the purpose. Sessions are not resumed: connections are few and long, and without tickets a server never writes to a
client that only writes.
"""

from __future__ import annotations

import os
import secrets
import ssl
import tempfile
from pathlib import Path
from typing import Any, Protocol

from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, PrivateFormat, load_pem_private_key

from scenefold.base.errors import DamagedData, LocalFault, PeerFault
from scenefold.base.ids import KeyId
from scenefold.crypto.authority import Identity
from scenefold.crypto.cards import Card
from scenefold.crypto.names import NAME_PATTERN
from scenefold.crypto.tls_reading import LumpedReading


class HasCertificate(Protocol):
    """An ssl.SSLSocket, ssl.SSLObject, or trio.SSLStream after its handshake."""

    def getpeercert(self, binary_form: bool = False, /) -> Any: ...


def server_context(identity: Identity, authority_certificate: bytes, *, newcomers: bool = False) -> ssl.SSLContext:
    """For the side that accepts connections; it must be a node's identity.

    `newcomers`: a peer may show no certificate, and then it is the caller who sees that it is told nothing but how to get one.
    """
    if not identity.name.startswith("node:"):
        raise LocalFault(f"{identity.name} cannot accept connections", remedy="use a node's identity")
    context = _context(ssl.PROTOCOL_TLS_SERVER, identity, authority_certificate)
    context.num_tickets = 0
    if newcomers:
        context.verify_mode = ssl.CERT_OPTIONAL
    return context


def client_context(identity: Identity, authority_certificate: bytes) -> ssl.SSLContext:
    """For the side that connects; it checks that the other's certificate contains the address dialled."""
    context = _context(ssl.PROTOCOL_TLS_CLIENT, identity, authority_certificate)
    context.check_hostname = True
    return context


def newcomer_context() -> ssl.SSLContext:
    """For who has no certificate yet, and does not know the authority's: the caller judges the other side's by `peer_certificate`."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def renew(context: ssl.SSLContext, identity: Identity) -> None:
    """Let a context show another certificate from its next handshake on; LocalFault if it is unusable."""
    try:
        _load_identity(context, identity)
    except (ssl.SSLError, ValueError) as error:
        raise LocalFault(f"the certificate or key is unusable: {error}", where=identity.where, remedy="issue it anew") from None


def _context(protocol: ssl._SSLMethod, identity: Identity, authority_certificate: bytes) -> ssl.SSLContext:
    context = ssl.SSLContext(protocol)
    context.sslobject_class = LumpedReading
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.verify_mode = ssl.CERT_REQUIRED
    context.verify_flags |= ssl.VERIFY_X509_STRICT
    try:
        context.load_verify_locations(cadata=authority_certificate.decode("ascii"))
        _load_identity(context, identity)
    except (ssl.SSLError, ValueError) as error:
        raise LocalFault(f"the certificate or key is unusable: {error}", where=identity.where, remedy="issue it anew") from None
    return context


def _load_identity(context: ssl.SSLContext, identity: Identity) -> None:
    # OpenSSL is reached by file name only. An anonymous memory file leaves no key behind in a temporary folder.
    if hasattr(os, "memfd_create"):
        handle = os.memfd_create("scenefold-identity")
        with os.fdopen(handle, "wb") as file:
            file.write(identity.certificate + identity.key)
            file.flush()
            context.load_cert_chain(f"/proc/self/fd/{handle}")
        return
    # Where the system has none, what a killed process leaves on the disk opens for nobody.
    passphrase = secrets.token_hex(32)
    handle, path = tempfile.mkstemp()
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(identity.certificate + _locked_key(identity.key, passphrase))
            file.flush()
            context.load_cert_chain(path, password=passphrase)
    finally:
        Path(path).unlink()


def _locked_key(pem: bytes, passphrase: str) -> bytes:
    key = load_pem_private_key(pem, password=None)
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(passphrase.encode()))


def peer_name(connection: HasCertificate) -> str:
    """Whom the other side's certificate names: "node:<id>" or "user:<name>". PeerFault if it names nobody."""
    certificate = connection.getpeercert() or {}
    for attributes in certificate.get("subject", ()):
        for key, value in attributes:
            if key == "commonName" and NAME_PATTERN.fullmatch(value):
                return str(value)
    raise PeerFault("the other side's certificate names no member of a cluster")


def peer_certificate(connection: HasCertificate) -> bytes:
    """The other side's certificate (DER); empty if it showed none."""
    return connection.getpeercert(True) or b""


def peer_key(connection: HasCertificate) -> KeyId | None:
    """The id of the key that the other side signs with, by its certificate; None if that holds none."""
    try:
        return Card.read(peer_certificate(connection)).signing_id
    except DamagedData:
        return None
