"""If this fails, a damaged file of a profile is found out late, in words that point elsewhere, or not at all."""

from __future__ import annotations

import base64
from pathlib import Path

import pytest

from scenefold.base.errors import DamagedData, LocalFault, ScenefoldError
from scenefold.crypto import NotOfThisCluster
from scenefold.crypto.secrets_on_disk import write_secret
from scenefold.world.own_papers import check_papers
from scenefold.world.profile import ClusterProfile


@pytest.fixture
def profile(tmp_path: Path) -> ClusterProfile:
    return ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])


def look(profile: ClusterProfile) -> None:
    check_papers(profile, profile.user_identity(), profile.user_secrets())


def spoil(path: Path) -> None:
    """One bit of the DER in a PEM file, behind its outermost header."""
    lines = path.read_text().splitlines()
    der = bytearray(base64.b64decode("".join(lines[1:-1])))
    der[len(der) - 5] ^= 1
    body = base64.encodebytes(bytes(der)).decode()
    write_secret(path, f"{lines[0]}\n{body}{lines[-1]}\n".encode(), replace=True)


def test_a_whole_profile_has_nothing_wrong(profile: ClusterProfile) -> None:
    look(profile)


def test_a_damaged_certificate_is_not_taken_for_that_of_another_cluster(profile: ClusterProfile, tmp_path: Path) -> None:
    mine = profile.user_folder() / "certificate.pem"
    whole = mine.read_bytes()
    spoil(mine)
    with pytest.raises(DamagedData, match="the certificate is damaged") as caught:
        look(profile)
    assert not isinstance(caught.value, NotOfThisCluster) and str(profile.folder) in caught.value.where
    # Of the same name, and another one all the same.
    other = ClusterProfile.create(tmp_path / "other", "studio", ["127.0.0.2"])
    write_secret(mine, (other.user_folder() / "certificate.pem").read_bytes(), replace=True)
    with pytest.raises(ScenefoldError):
        look(profile)
    write_secret(mine, whole, replace=True)
    look(profile)


def test_a_damaged_certificate_of_the_authority_is_named_by_its_file(profile: ClusterProfile) -> None:
    spoil(profile.folder / "authority" / "certificate.pem")
    with pytest.raises(LocalFault, match="the authority's certificate is damaged") as caught:
        look(profile)
    assert caught.value.where.endswith("authority/certificate.pem")


@pytest.mark.parametrize("name", ["signing.seed", "sealing.seed"])
def test_keys_that_are_not_those_of_the_certificate_are_no_keys(name: str, profile: ClusterProfile, tmp_path: Path) -> None:
    other = ClusterProfile.create(tmp_path / "other", "other", ["127.0.0.2"])
    write_secret(profile.user_folder() / name, (other.user_folder() / name).read_bytes(), replace=True)
    with pytest.raises(LocalFault, match=r"not the keys that the certificate names.*backup"):
        look(profile)
