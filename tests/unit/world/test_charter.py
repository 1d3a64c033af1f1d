"""If this fails, a newcomer believes a charter that the cluster's authority did not sign, or reads something else out of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenefold.base.errors import DamagedData
from scenefold.crypto import AUTHORITY_PURPOSE, Authority
from scenefold.world import Ports
from scenefold.world.charter import Charter, facts_of
from scenefold.world.profile import ClusterProfile


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> ClusterProfile:
    folder = tmp_path_factory.mktemp("profiles") / "studio"
    return ClusterProfile.create(folder, "studio", ["127.0.0.2", "127.0.0.3"], spares=["127.0.0.9"], ports=Ports(20001, 20002))


def test_the_charter_says_what_the_facts_say_and_no_more(profile: ClusterProfile) -> None:
    facts = profile.facts()
    chartered = facts_of(facts.charter, facts.authority)
    assert chartered.genesis_header == facts.genesis_header and chartered.cluster_id == facts.cluster_id
    assert chartered.founders == facts.founders and chartered.voters == facts.voters and chartered.ports == facts.ports
    assert [one.address for one in chartered.credentials] == ["127.0.0.2", "127.0.0.3"], "spares are nobody to a newcomer"
    assert Charter.of(chartered) == Charter.of(facts)


def test_any_flipped_bit_of_a_charter_is_refused(profile: ClusterProfile) -> None:
    facts = profile.facts()
    for bit in range(8 * len(facts.charter)):
        bent = bytearray(facts.charter)
        bent[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DamagedData):
            facts_of(bytes(bent), facts.authority)


def test_a_charter_of_another_authority_is_refused(profile: ClusterProfile) -> None:
    other = Authority.create("studio")
    with pytest.raises(DamagedData, match="authority"):
        facts_of(profile.charter, other.certificate)
    with pytest.raises(DamagedData):
        facts_of(Charter.of(profile.facts()).signed(other), profile.authority_certificate())


def test_the_first_founder_alone_can_open_the_authoritys_key(profile: ClusterProfile, tmp_path: Path) -> None:
    sealed = profile.sealed_authority("127.0.0.2")
    assert sealed is not None and profile.sealed_authority("127.0.0.3") is None
    opened = profile.node_secrets("127.0.0.2").sealing.open(sealed, AUTHORITY_PURPOSE, profile.cluster_id)
    assert opened == profile.authority().key_der() and opened not in sealed
    with pytest.raises(DamagedData):
        profile.node_secrets("127.0.0.3").sealing.open(sealed, AUTHORITY_PURPOSE, profile.cluster_id)
    with pytest.raises(DamagedData):
        profile.node_secrets("127.0.0.2").sealing.open(sealed, AUTHORITY_PURPOSE, bytes(16))
