"""The public halves of TLS keys: P-256, in DER, written in the one way (specs/04-records.md, Certificates)."""

from __future__ import annotations

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_der_public_key

from scenefold.base.errors import DamagedData


def tls_key_of(key: ec.EllipticCurvePrivateKey) -> bytes:
    """The public half, as `Authority.certify` takes it."""
    return _der_of(key.public_key())


def public_tls_key(der: bytes) -> ec.EllipticCurvePublicKey:
    """The key in these bytes; DamagedData if they are none."""
    try:
        key = load_der_public_key(der)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        raise DamagedData("the TLS key is no key") from None
    return _checked(key)


def check_tls_key(der: bytes) -> None:
    """DamagedData unless a certificate may be for this key, and would hold these very bytes of it."""
    if _der_of(public_tls_key(der)) != der:
        raise DamagedData("the TLS key is not written as it should be")


def tls_key_from(key: object) -> bytes:
    """The bytes of a key that a certificate holds; DamagedData if it may be for none such."""
    return _der_of(_checked(key))


def _checked(key: object) -> ec.EllipticCurvePublicKey:
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise DamagedData("the TLS key is none of P-256")
    return key


def _der_of(key: ec.EllipticCurvePublicKey) -> bytes:
    return key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
