"""The cluster's own certificate authority (specs/04-records.md, Certificates).

`cluster init` makes one; it issues a certificate to each node and user. A peer is whom its certificate names:
"node:<id>" (with its IP addresses, may serve and connect) or "user:<name>" (may only connect). Nobody else's
authority counts, ours signs nobody else: there is no intermediate, and it is used for nothing but this cluster.
"""

from __future__ import annotations

import datetime
import ipaddress
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from cryptography import x509
from cryptography.exceptions import InvalidSignature as _InvalidSignature
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_der_private_key,
    load_pem_private_key,
)
from cryptography.utils import CryptographyDeprecationWarning
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto.cards import MEMBER_KEYS, MemberKeys
from scenefold.crypto.keys import InvalidSignature
from scenefold.crypto.names import NAME_PATTERN, common_name
from scenefold.crypto.secret_folder import SecretFolder
from scenefold.crypto.secrets_on_disk import make_private_folder, read_certificate, read_secret, write_secret
from scenefold.crypto.tls_keys import public_tls_key, tls_key_of

AUTHORITY_YEARS = 10
LEAF_DAYS = 365
SKEW = datetime.timedelta(days=1)
"""Certificates are valid from a day ago: an old computer's clock may be behind."""
_UNREADABLE = (ValueError, TypeError, UnsupportedAlgorithm, x509.InvalidVersion, CryptographyDeprecationWarning)
"""What the library raises for bytes that are no key or certificate, depending on which bit is wrong."""
CERTIFICATE_FILE = "certificate.pem"
KEY_FILE = "key.pem"


@dataclass(frozen=True, slots=True)
class Identity:
    """A certificate with its private key, both as PEM."""

    name: str
    certificate: bytes
    key: bytes = field(repr=False)
    folder: Path | None = field(default=None, compare=False)
    """Whose files it was read from, for messages."""

    @property
    def where(self) -> str:
        """What a message about the certificate or the key names."""
        return self.name if self.folder is None else str(self.folder / CERTIFICATE_FILE)

    def to_files(self, folder: Path) -> None:
        """Writes certificate and key, 0600 in a folder of 0700; LocalFault if they exist."""
        make_private_folder(folder)
        write_secret(folder / KEY_FILE, self.key)
        write_secret(folder / CERTIFICATE_FILE, self.certificate)

    @classmethod
    def from_files(cls, folder: Path, secrets: SecretFolder | None = None) -> Self:
        """The identity in a folder, its key through `secrets` if they are locked; LocalFault if it is missing, exposed or damaged."""
        certificate, key = read_certificate(folder / CERTIFICATE_FILE), (secrets or SecretFolder(folder)).read(KEY_FILE)
        name, parsed = _matching_key(certificate, key, folder)
        # Both anew, since TLS reads files more strictly than we do.
        return cls(name, x509.load_pem_x509_certificate(certificate).public_bytes(Encoding.PEM), _key_pem(parsed), folder)


class Authority:
    """Issues the certificates of one cluster. Who holds its key decides who is in."""

    __slots__ = ("_certificate", "_key", "certificate")

    def __init__(self, certificate: bytes, key: ec.EllipticCurvePrivateKey) -> None:
        self.certificate = certificate
        """PEM: what every member needs to know its peers."""
        self._certificate = x509.load_pem_x509_certificate(certificate)
        self._key = key

    @classmethod
    def create(cls, name: str, *, now: datetime.datetime | None = None) -> Self:
        """A new authority for the cluster `name`, valid for ten years."""
        if not 0 < len(name) <= 50:
            raise LocalFault("a cluster's name has 1 to 50 characters")
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"scenefold {name}")])
        certificate = (
            _draft(subject, subject, key.public_key(), now, datetime.timedelta(days=365 * AUTHORITY_YEARS))
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_certificates=True), critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
            .sign(key, hashes.SHA256())
        )
        return cls(certificate.public_bytes(Encoding.PEM), key)

    def issue(self, name: str, addresses: list[str], *, keys: MemberKeys | None = None, now: datetime.datetime | None = None) -> Identity:
        """A new TLS key and a certificate for it, valid for a year. A node is reached at `addresses` (IP addresses)."""
        key = ec.generate_private_key(ec.SECP256R1())
        return Identity(name, self.certify(name, addresses, tls_key_of(key), keys=keys, now=now), _key_pem(key))

    def certify(
        self, name: str, addresses: list[str], tls_key: bytes, *, keys: MemberKeys | None = None, now: datetime.datetime | None = None
    ) -> bytes:
        """A certificate (PEM), valid for a year, for a TLS key that was made elsewhere: P-256, DER. DamagedData if it is another."""
        if not NAME_PATTERN.fullmatch(name):
            raise LocalFault(f"{name!r} names no member", remedy='use "node:<number>" or "user:<name>" with letters, digits and . _ @ -')
        key = public_tls_key(tls_key)
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if name.startswith("node:"):
            uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        builder = (
            _draft(subject, self._certificate.subject, key, now, datetime.timedelta(days=LEAF_DAYS))
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key()), critical=False)
        )
        if addresses:
            builder = builder.add_extension(x509.SubjectAlternativeName([_address(text) for text in addresses]), critical=False)
        if keys is not None:
            builder = builder.add_extension(x509.UnrecognizedExtension(MEMBER_KEYS, keys.encode()), critical=False)
        return builder.sign(self._key, hashes.SHA256()).public_bytes(Encoding.PEM)

    def sign(self, domain: bytes, message: bytes) -> bytes:
        """ECDSA with SHA-256, for what every member must believe and no certificate says; see `check_signed`."""
        return self._key.sign(_domained(domain, message), ec.ECDSA(hashes.SHA256()))

    def key_der(self) -> bytes:
        """The private key (PKCS8, DER): only to be sealed to those that may hold it."""
        return self._key.private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption())

    @classmethod
    def from_key(cls, certificate: bytes, key_der: bytes) -> Self:
        """The authority of a certificate (PEM) and what `key_der` gave; DamagedData if they are not of one."""
        try:
            key = load_der_private_key(key_der, password=None)
            public = x509.load_pem_x509_certificate(certificate).public_key()
        except _UNREADABLE:
            raise DamagedData("the sealed key of the authority is none") from None
        if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != public:
            raise DamagedData("the sealed key is that of another authority")
        return cls(certificate, key)

    def to_files(self, folder: Path) -> None:
        """Writes certificate and key, 0600 in a folder of 0700; LocalFault if they exist."""
        make_private_folder(folder)
        write_secret(folder / KEY_FILE, _key_pem(self._key))
        write_secret(folder / CERTIFICATE_FILE, self.certificate)

    @classmethod
    def from_files(cls, folder: Path) -> Self:
        """The authority in a folder; LocalFault if it is missing, exposed or damaged."""
        certificate = read_authority_certificate(folder)
        return cls(certificate, _matching_key(certificate, read_secret(folder / KEY_FILE), folder)[1])


def check_signed(certificate: bytes, signature: bytes, domain: bytes, message: bytes) -> None:
    """Returns if the authority of this certificate (PEM) signed the message; InvalidSignature otherwise."""
    try:
        key = x509.load_pem_x509_certificate(certificate).public_key()
        assert isinstance(key, ec.EllipticCurvePublicKey)
        key.verify(signature, _domained(domain, message), ec.ECDSA(hashes.SHA256()))
    except (AssertionError, _InvalidSignature, *_UNREADABLE):
        raise InvalidSignature("the signature is not that of the cluster's authority") from None


def _domained(domain: bytes, message: bytes) -> bytes:
    assert 0 < len(domain) < 256
    return b"".join((bytes((len(domain),)), domain, message))


def read_authority_certificate(folder: Path) -> bytes:
    """The authority's certificate (PEM) alone, for members that do not hold its key; LocalFault if it is none, or damaged."""
    path = folder / CERTIFICATE_FILE
    pem = read_certificate(path)
    with _readable("certificate", path):
        certificate = x509.load_pem_x509_certificate(pem)
    try:
        certificate.verify_directly_issued_by(certificate)
    except (_InvalidSignature, *_UNREADABLE):
        raise LocalFault("the authority's certificate is damaged", where=str(path), remedy="restore it from a backup") from None
    # Anew, since TLS reads files more strictly than we do.
    return certificate.public_bytes(Encoding.PEM)


def _draft(
    subject: x509.Name,
    issuer: x509.Name,
    public_key: ec.EllipticCurvePublicKey,
    now: datetime.datetime | None,
    lifetime: datetime.timedelta,
) -> x509.CertificateBuilder:
    moment = datetime.datetime.now(datetime.UTC) if now is None else now
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(moment - SKEW)
        .not_valid_after(moment + lifetime)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _address(text: str) -> x509.IPAddress:
    try:
        return x509.IPAddress(ipaddress.ip_address(text))
    except ValueError:
        raise LocalFault(f"{text!r} is no IP address", remedy="give it as four numbers, such as 192.168.1.20") from None


def new_tls_key() -> bytes:
    """A private key for TLS (PEM), made where it is used; `tls_key_in` gives what the authority certifies."""
    return _key_pem(ec.generate_private_key(ec.SECP256R1()))


def tls_key_in(pem: bytes, where: str = "") -> bytes:
    """The public half (DER) of what `new_tls_key` made; LocalFault naming `where` if it is none."""
    try:
        key = load_pem_private_key(pem, password=None)
    except _UNREADABLE:
        key = None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise LocalFault("the TLS key is none, or damaged", where=where, remedy="begin again with another token")
    return tls_key_of(key)


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def _matching_key(certificate: bytes, pem: bytes, folder: Path) -> tuple[str, ec.EllipticCurvePrivateKey]:
    """Whom the certificate names, and the key that it is for; LocalFault naming the file that is damaged."""
    with _readable("certificate", folder / CERTIFICATE_FILE):
        # The parts of a certificate are parsed only when they are asked for.
        parsed = x509.load_pem_x509_certificate(certificate)
        name, public_key = common_name(parsed), parsed.public_key()
    with _readable("private key", folder / KEY_FILE):
        key = load_pem_private_key(pem, password=None)
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != public_key:
        where = f"{folder / KEY_FILE} or {CERTIFICATE_FILE} beside it"
        raise LocalFault("the key does not belong to the certificate", where=where, remedy="restore both from one backup")
    return name, key


@contextmanager
def _readable(what: str, path: Path) -> Iterator[None]:
    """LocalFault naming the file if what is parsed within is none."""
    try:
        yield
    except _UNREADABLE:
        raise LocalFault(f"the file holds no {what}, or a damaged one", where=str(path), remedy="restore it from a backup") from None
