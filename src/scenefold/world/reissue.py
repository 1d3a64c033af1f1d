"""New certificates for the same keys, by the authority's own key: for a cluster, or one member, that slept until they had run out.

While nodes run, certificates are renewed by themselves (specs/15-cluster-log.md, Enrolling). Nothing here asks anybody: of revocations it knows what clients of the profile have seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.crypto import Authority, Card, write_secret
from scenefold.crypto.authority import CERTIFICATE_FILE, KEY_FILE
from scenefold.world.log_file import LogFile
from scenefold.world.log_view import LogView
from scenefold.world.own_papers import card_in_file, opened_authority
from scenefold.world.profile import ClusterProfile


def reissue(profile: ClusterProfile, places: Sequence[Path] = ()) -> list[Card]:
    """Replace every certificate of a node or user here by one that counts from today, for the same keys; their cards.

    `places`: instead, these files, copies of certificates of members whose keys are elsewhere. LocalFault without the authority's key,
    NotOfThisCluster for a certificate of another cluster, DamagedData for a damaged one, LocalFault for one whose key is revoked by what
    the profile has seen of the cluster's log (it need not have seen all: a revoked key stays revoked). Those before it are replaced then.
    """
    authority, cards = read_authority(profile), []
    view, _ = LogFile(profile.folder).load() if places else (LogView(), ())
    for place in places or _places(profile.folder):
        old = card_in_file(place, authority.certificate)
        refusal = view.refusal_of(old.name, old.signing_id)
        if refusal is not None:
            raise LocalFault(refusal.what, where=str(place), remedy="no certificate lets it count again: invite the member anew")
        pem = authority.certify(old.name, list(old.addresses), old.tls_key, keys=old.keys)
        write_secret(place, pem, replace=True)
        cards.append(Card.read(pem))
    return cards


def read_authority(profile: ClusterProfile) -> Authority:
    """The authority by its key in the profile: as it is, or sealed to a node whose keys lie there, too."""
    if not (profile.folder / "authority" / KEY_FILE).exists():
        here = [member for member in profile.members if (profile.folder / "nodes" / member.address).is_dir()]
        for member in here:
            authority = opened_authority(profile, member.address, profile.node_secrets(member.address))
            if authority is not None:
                return authority
        where, remedy = str(profile.folder), "call this where the cluster was made, or with the first node's profile"
        raise LocalFault("the profile does not hold the authority's key", where=where, remedy=remedy)
    return profile.authority()


def _places(folder: Path) -> list[Path]:
    return sorted(path for kind in ("nodes", "users") for path in (folder / kind).glob(f"[!.]*/{CERTIFICATE_FILE}"))
