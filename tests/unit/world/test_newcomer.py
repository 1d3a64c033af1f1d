"""If this fails, a newcomer writes a profile for an answer that it must not believe, or loses its keys on the way."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import pytest

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import node_id_of
from scenefold.crypto import Authority, Card, InvitedKind, MemberKeys, OutOfDate, Token, authority_der, mark_of
from scenefold.wire.enrol_packets import Enrolled
from scenefold.wire.orders import EnrolForm
from scenefold.world.charter import Charter
from scenefold.world.newcomer import Newcomer
from scenefold.world.profile import ClusterProfile

NOW = datetime.datetime.now(datetime.UTC)
NODE = node_id_of("127.0.0.9")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> ClusterProfile:
    return ClusterProfile.create(tmp_path_factory.mktemp("cluster") / "studio", "studio", ["127.0.0.2"])


def token_of(cluster: ClusterProfile, kind: InvitedKind, seed: bytes = b"t") -> Token:
    addresses = (node_id_of("127.0.0.2"),)
    return Token(kind, seed * 32, mark_of(cluster.authority_certificate()), 0, cluster.ports.low, cluster.ports.high, addresses)


def answer_to(
    newcomer: Newcomer, cluster: ClusterProfile, name: str, authority: Authority | None = None, now: datetime.datetime = NOW
) -> Enrolled:
    form = EnrolForm.decode(newcomer.request().form)
    authority = authority or cluster.authority()
    addresses = ["127.0.0.9"] if form.address else []
    pem = authority.certify(name, addresses, form.tls_key, keys=MemberKeys.decode(form.keys), now=now)
    facts = cluster.facts()
    return Enrolled(
        certificate=Card.read(pem).der, authority=authority_der(authority.certificate), charter=Charter.of(facts).signed(authority)
    )


def test_a_user_gets_a_profile_with_its_own_keys_and_nobody_elses(cluster: ClusterProfile, tmp_path: Path) -> None:
    newcomer = Newcomer.at(tmp_path / "mine", token_of(cluster, InvitedKind.USER))
    profile = newcomer.admitted(answer_to(newcomer, cluster, "user:ada"), NOW)
    assert profile.user == "ada" and profile.user_identity().name == "user:ada"
    assert profile.user_secrets().signing.public == newcomer.secrets.signing.public
    assert profile.facts().genesis_header == cluster.facts().genesis_header
    assert not (profile.folder / "authority" / "key.pem").exists() and not list(tmp_path.glob(".mine*"))
    assert all(path.stat().st_mode & 0o077 == 0 for path in profile.folder.rglob("*"))
    with pytest.raises(LocalFault, match="that of user ada"):
        Newcomer.at(tmp_path / "mine", token_of(cluster, InvitedKind.USER, b"u"))


def test_a_node_joins_a_profile_of_its_cluster_beside_the_user(cluster: ClusterProfile, tmp_path: Path) -> None:
    user = Newcomer.at(tmp_path / "mine", token_of(cluster, InvitedKind.USER))
    user.admitted(answer_to(user, cluster, "user:ada"), NOW)
    node = Newcomer.at(tmp_path / "mine", token_of(cluster, InvitedKind.NODE, b"n"), NODE)
    profile = node.admitted(answer_to(node, cluster, f"node:{NODE}"), NOW)
    assert profile.user == "ada" and profile.user_identity().name == "user:ada"
    assert profile.node_secrets("127.0.0.9").signing.public == node.secrets.signing.public
    assert [member.address for member in profile.members] == ["127.0.0.2", "127.0.0.9"] and profile.seeds == ("127.0.0.2",)


def test_the_same_token_has_the_same_keys_until_they_are_in_the_profile(cluster: ClusterProfile, tmp_path: Path) -> None:
    token = token_of(cluster, InvitedKind.USER)
    assert Newcomer.at(tmp_path / "mine", token).request() == Newcomer.at(tmp_path / "mine", token).request()
    assert Newcomer.at(tmp_path / "other", token).request() != Newcomer.at(tmp_path / "mine", token).request()
    newcomer = Newcomer.at(tmp_path / "mine", token)
    answer = answer_to(newcomer, cluster, "user:ada")
    for late in (-400, 400):
        with pytest.raises(OutOfDate, match="this clock says"):
            newcomer.admitted(answer, NOW + datetime.timedelta(days=late))
    again = Newcomer.at(tmp_path / "mine", token)
    assert again.admitted(answer, NOW).user == "ada", "once the clock is right, the answer is taken"


def test_keys_that_are_forgotten_leave_nothing_beside_the_profile(cluster: ClusterProfile, tmp_path: Path) -> None:
    token = token_of(cluster, InvitedKind.USER)
    assert not Newcomer.at(tmp_path / "mine", token).asked_before
    again = Newcomer.at(tmp_path / "mine", token)
    assert again.asked_before
    again.forget()
    assert not list(tmp_path.iterdir())
    assert not Newcomer.at(tmp_path / "mine", token).asked_before


def test_an_answer_that_is_not_for_us_or_not_of_our_cluster_makes_no_profile(cluster: ClusterProfile, tmp_path: Path) -> None:
    newcomer = Newcomer.at(tmp_path / "mine", token_of(cluster, InvitedKind.USER))
    other = Newcomer.at(tmp_path / "other", token_of(cluster, InvitedKind.USER))
    good, foreign = answer_to(newcomer, cluster, "user:ada"), Authority.create("studio")
    bad = [
        answer_to(other, cluster, "user:ada"),
        answer_to(newcomer, cluster, f"node:{NODE}"),
        answer_to(newcomer, cluster, "user:ada", foreign),
        replace(good, certificate=answer_to(newcomer, cluster, "user:ada", foreign).certificate),
        replace(good, charter=answer_to(newcomer, cluster, "user:ada", foreign).charter),
        replace(good, authority=b"none"),
        replace(good, certificate=b"none"),
        replace(good, charter=b""),
    ]
    for answer in bad:
        with pytest.raises(DamagedData):
            newcomer.admitted(answer, NOW)
        assert not (tmp_path / "mine").exists()
    with pytest.raises(LocalFault, match="cannot be the name"):
        newcomer.admitted(answer_to(newcomer, cluster, "user:.."), NOW)
    assert newcomer.admitted(good, NOW).user == "ada"


def test_a_profile_of_another_cluster_is_left_alone(cluster: ClusterProfile, tmp_path: Path) -> None:
    ClusterProfile.create(tmp_path / "mine", "other", ["127.0.0.2"])
    with pytest.raises(LocalFault, match="of another cluster than the token"):
        Newcomer.at(tmp_path / "mine", token_of(cluster, InvitedKind.USER))
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "picture.png").write_bytes(b"")
    with pytest.raises(LocalFault, match="taken by something else"):
        Newcomer.at(tmp_path / "taken", token_of(cluster, InvitedKind.USER))


def test_a_damaged_key_that_waits_for_its_certificate_is_named(cluster: ClusterProfile, tmp_path: Path) -> None:
    """Whichever bit it is; what still is a key becomes the one that is certified."""
    token = token_of(cluster, InvitedKind.USER)
    Newcomer.at(tmp_path / "mine", token)
    (kept,) = tmp_path.glob(".mine*/key.pem")
    content, problems = kept.read_bytes(), list[LocalFault]()
    for bit in range(0, 8 * len(content), 13):
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        kept.write_bytes(changed)
        try:
            Newcomer.at(tmp_path / "mine", token).request()
        except LocalFault as problem:
            problems.append(problem)
    assert problems and all(problem.where == str(kept) and problem.remedy for problem in problems)
