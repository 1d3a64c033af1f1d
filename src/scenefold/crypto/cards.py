"""Who somebody is, and the keys that go with the name, as the cluster's authority says (specs/04-records.md, Certificates).

A member's certificate binds its name to three keys: that of TLS, and in an extension of our own the one that it signs with and
the one that things are sealed to. So one document, verified against the authority alone, tells whose signature counts and whom a
scene's key may be sealed to, whoever handed it over.

    extension, identifier 2.25.(a UUID), not critical:
        version u8 = 1 | flags u8 | signing suite u8 | length u16 | signing key | sealing suite u8 | length u16 | sealing key
        flags: 1 = administrator
"""

from __future__ import annotations

import datetime
import struct
from dataclasses import dataclass
from typing import Self

from cryptography import x509
from cryptography.exceptions import InvalidSignature as _InvalidSignature
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.utils import CryptographyDeprecationWarning

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId
from scenefold.crypto.keys import PublicKey
from scenefold.crypto.names import NAME_PATTERN, common_name
from scenefold.crypto.sealing_keys import SealingPublicKey
from scenefold.crypto.tls_keys import tls_key_from

MEMBER_KEYS = x509.ObjectIdentifier("2.25.148122825122386051277728952077388622717")
CARD_BYTES_MAX = 4096
"""A certificate with RSA keys has less than half of it."""
_HEAD = struct.Struct(">BB")
_KEY = struct.Struct(">BH")
_VERSION = 1
_ADMINISTRATOR = 1
_RENEWED = "send the certificate to who has the authority's key, for scenectl cluster renew FILE (docs: Keep your keys)"
_BIT_STRING = 3
"""Its tag in DER; a signature of P-256 is short enough for a length of one byte."""


class NotOfThisCluster(DamagedData):
    """A certificate that another authority issued, or nobody that we know."""


class OutOfDate(DamagedData):
    """A certificate before or after its time."""


@dataclass(frozen=True, slots=True)
class MemberKeys:
    """The public keys of a member besides that of TLS."""

    signing: PublicKey
    sealing: SealingPublicKey
    is_administrator: bool = False

    def __post_init__(self) -> None:
        if self.signing.raw == self.sealing.raw:
            raise DamagedData("the key that a member signs with is the one that is sealed to it")

    def encode(self) -> bytes:
        """The bytes of the extension."""
        parts = [_HEAD.pack(_VERSION, _ADMINISTRATOR if self.is_administrator else 0)]
        for key in (self.signing, self.sealing):
            parts += [_KEY.pack(key.suite, len(key.raw)), key.raw]
        return b"".join(parts)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """What `encode` made; DamagedData for anything else."""
        try:
            version, flags = _HEAD.unpack_from(data)
            if version != _VERSION or flags & ~_ADMINISTRATOR:
                raise DamagedData(f"the keys in a certificate have version {version}, flags {flags}", remedy="update this program")
            keys, at = [], _HEAD.size
            for _ in range(2):
                suite, length = _KEY.unpack_from(data, at)
                keys.append((data[at + _KEY.size : at + _KEY.size + length], suite))
                at += _KEY.size + length
        except struct.error:
            raise DamagedData("the keys in a certificate end too early") from None
        if at != len(data):
            raise DamagedData("the keys in a certificate are followed by something else")
        return cls(PublicKey(*keys[0]), SealingPublicKey(*keys[1]), bool(flags & _ADMINISTRATOR))


@dataclass(frozen=True, slots=True)
class Card:
    """A certificate of our authority, verified and taken apart."""

    name: str
    """ "node:<id>" or "user:<name>"."""
    addresses: tuple[str, ...]
    keys: MemberKeys
    serial: int
    not_before: datetime.datetime
    not_after: datetime.datetime
    der: bytes

    @property
    def signing_id(self) -> KeyId:
        return self.keys.signing.key_id

    @property
    def renew_from(self) -> datetime.datetime:
        """When two thirds of its time are over: from then on its holder asks for a newer one."""
        return self.not_after - (self.not_after - self.not_before) / 3

    def counts(self, now: datetime.datetime) -> bool:
        """Whether it is neither before nor after its time."""
        return self.not_before <= now <= self.not_after

    def check_renewed(self, certificate: bytes, authority: bytes, now: datetime.datetime) -> Card:
        """The card in a newer certificate of the same member, which counts now; OutOfDate, or DamagedData if it is anything else."""
        newer = Card.verified(certificate, authority, now)
        same = (newer.name, newer.addresses, newer.keys, newer.tls_key) == (self.name, self.addresses, self.keys, self.tls_key)
        if not same or (self.counts(now) and newer.not_after <= self.not_after):
            raise DamagedData("what came in place of the certificate is no newer one of the same member", where=self.name)
        return newer

    @property
    def tls_key(self) -> bytes:
        """The public key that the certificate is for (DER); DamagedData if it is none of P-256."""
        try:
            key = _parsed(self.der).public_key()
        except (ValueError, TypeError, UnsupportedAlgorithm):
            raise DamagedData("the certificate is for no key", where=self.name) from None
        return tls_key_from(key)

    @classmethod
    def verified(cls, certificate: bytes, authority: bytes, now: datetime.datetime | None = None) -> Self:
        """The card in a certificate (PEM or DER), if the authority (PEM) issued it.

        NotOfThisCluster if another did, OutOfDate at `now` (not looked at if None), DamagedData if it is no certificate of a member, or
        one that says that this authority issued it, and is not signed so.
        """
        parsed, issuer = _parsed(certificate), x509.load_pem_x509_certificate(authority)
        try:
            parsed.verify_directly_issued_by(issuer)
        except (ValueError, TypeError, UnsupportedAlgorithm, _InvalidSignature):
            if _names_issuer(parsed, issuer):
                remedy = "restore it from a backup, or have it renewed: scenectl cluster renew"
                raise DamagedData("the certificate is damaged: the authority has not signed it as it is", remedy=remedy) from None
            raise NotOfThisCluster("the certificate is of another cluster", remedy="use one that this cluster's authority issued") from None
        _check_end(parsed)
        card = cls._of(parsed)
        if now is not None:
            _check_time(card, now)
        return card

    @classmethod
    def read(cls, certificate: bytes) -> Self:
        """The card in a certificate that was verified before, by whoever put it where it comes from; DamagedData if it is none."""
        return cls._of(_parsed(certificate))

    @classmethod
    def _of(cls, parsed: x509.Certificate) -> Self:
        # What a certificate holds is read only here, piece by piece, whatever it was that parsed as one.
        try:
            name = common_name(parsed)
            if not NAME_PATTERN.fullmatch(name):
                raise DamagedData("the certificate names no member of a cluster")
            extension = parsed.extensions.get_extension_for_oid(MEMBER_KEYS).value
            if not isinstance(extension, x509.UnrecognizedExtension):
                raise DamagedData("the certificate holds no member's keys", where=name)
            return cls(
                name,
                _addresses(parsed),
                MemberKeys.decode(extension.value),
                parsed.serial_number,
                parsed.not_valid_before_utc,
                parsed.not_valid_after_utc,
                parsed.public_bytes(Encoding.DER),
            )
        except x509.ExtensionNotFound:
            raise DamagedData("the certificate holds no member's keys", where=name, remedy="have it issued anew") from None
        except (ValueError, TypeError, x509.DuplicateExtension, x509.UnsupportedGeneralNameType, UnsupportedAlgorithm):
            raise DamagedData("the certificate is damaged") from None


def _parsed(certificate: bytes) -> x509.Certificate:
    if len(certificate) > CARD_BYTES_MAX:
        raise DamagedData(f"a certificate of {len(certificate)} bytes, at most {CARD_BYTES_MAX} are looked at")
    try:
        if certificate.lstrip().startswith(b"-----"):
            return x509.load_pem_x509_certificate(certificate)
        return x509.load_der_x509_certificate(certificate)
    except (ValueError, x509.InvalidVersion, UnsupportedAlgorithm, CryptographyDeprecationWarning):
        # The warning, where warnings are errors, is of a serial number below 1; later versions of the library raise ValueError for it.
        raise DamagedData("these bytes are no certificate") from None


def _names_issuer(certificate: x509.Certificate, issuer: x509.Certificate) -> bool:
    """Whether a certificate names the issuer's key as the one that signed it."""
    try:
        named = issuer.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value.digest
    except (x509.ExtensionNotFound, x509.DuplicateExtension, x509.UnsupportedGeneralNameType, ValueError, TypeError, UnsupportedAlgorithm):
        return False
    # The name is looked for in the bytes: around it a damaged certificate may hold whatever, about which its parser warns or fails.
    return named in certificate.tbs_certificate_bytes


def _check_end(certificate: x509.Certificate) -> None:
    """DamagedData unless the signature at the end is written in the one way: parsers take any count of unused bits that are zero."""
    signature = certificate.signature
    if not certificate.public_bytes(Encoding.DER).endswith(bytes((_BIT_STRING, len(signature) + 1, 0)) + signature):
        raise DamagedData("the certificate's signature is not written as it should be")


def _check_time(card: Card, now: datetime.datetime) -> None:
    first, last = card.not_before, card.not_after
    if now < first:
        raise OutOfDate(
            f"the certificate is valid from {first:%Y-%m-%d}, and this clock says {now:%Y-%m-%d}",
            where=card.name,
            remedy=f"set the clock right; if it is, a wrong one dated the certificate: {_RENEWED}",
        )
    if now > last:
        remedy = f"if that date lies ahead, set the clock right; else {_RENEWED}"
        what = f"the certificate was valid until {last:%Y-%m-%d}, and this clock says {now:%Y-%m-%d}"
        raise OutOfDate(what, where=card.name, remedy=remedy)


def _addresses(certificate: x509.Certificate) -> tuple[str, ...]:
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    return tuple(str(address) for address in names.get_values_for_type(x509.IPAddress))
