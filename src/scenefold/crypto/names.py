"""Whom a certificate names."""

from __future__ import annotations

import re

from cryptography import x509
from cryptography.x509.oid import NameOID

NAME_PATTERN = re.compile(r"node:[0-9]{1,10}|user:[A-Za-z0-9._@-]{1,50}")


def common_name(certificate: x509.Certificate) -> str:
    """The subject's common name; empty if there is none."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""
