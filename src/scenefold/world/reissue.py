"""New certificates for all keys in a profile, by the authority's own key: for a cluster that slept until they had run out.

While nodes run, certificates are renewed by themselves (specs/15-cluster-log.md, Enrolling). Nothing here asks anybody.
"""

from __future__ import annotations

from pathlib import Path

from scenefold.crypto import Card, write_secret
from scenefold.crypto.authority import CERTIFICATE_FILE
from scenefold.crypto.secrets_on_disk import read_certificate
from scenefold.world.profile import ClusterProfile


def reissue(profile: ClusterProfile) -> list[Card]:
    """Replace every certificate of a node or user here by one that counts from today, for the same keys; their cards.

    LocalFault without the authority's key, DamagedData for a certificate of another cluster.
    """
    authority, cards = profile.authority(), []
    for place in _places(profile.folder):
        old = Card.verified(read_certificate(place), authority.certificate)
        pem = authority.certify(old.name, list(old.addresses), old.tls_key, keys=old.keys)
        write_secret(place, pem, replace=True)
        cards.append(Card.read(pem))
    return cards


def _places(folder: Path) -> list[Path]:
    return sorted(path for kind in ("nodes", "users") for path in (folder / kind).glob(f"[!.]*/{CERTIFICATE_FILE}"))
