"""If this fails, a farm that nobody looks after stops one day, when its certificates run out; or a wrong clock is not called by its name."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest
import trio

from integration.clusters import PATIENCE_S, nodes_here
from loopback import addresses, free_ports
from scenefold.base.errors import DamagedData, LocalFault
from scenefold.client import connect
from scenefold.crypto import Authority, Card, Identity, NotOfThisCluster, OutOfDate, newcomer_context
from scenefold.crypto.secrets_on_disk import write_secret
from scenefold.node import NodeSettings, run_node
from scenefold.world.profile import ClusterProfile
from scenefold.world.reissue import read_authority, reissue

LOOK_S = 0.1
DAY = datetime.timedelta(days=1)


def aged(profile: ClusterProfile, folder: str, by: datetime.timedelta) -> Card:
    """Let the certificate in a folder be as if it had been issued so long ago."""
    place = profile.folder / folder
    card = Card.read(Identity.from_files(place).certificate)
    authority: Authority = profile.authority()
    now = datetime.datetime.now(datetime.UTC) - by
    pem = authority.certify(card.name, list(card.addresses), card.tls_key, keys=card.keys, now=now)
    write_secret(place / "certificate.pem", pem, replace=True)
    return Card.read(pem)


def made(folder: Path, count: int = 2) -> ClusterProfile:
    return ClusterProfile.create(folder / "profile", "trial", addresses(count), ports=free_ports(addresses(count)))


async def shown_by(profile: ClusterProfile, address: str) -> Card:
    """The card that a node shows to who connects now."""
    stream = await trio.open_tcp_stream(address, profile.ports.high)
    context = newcomer_context()
    context.set_alpn_protocols(["scenefold-enrol/1"])
    async with trio.SSLStream(stream, context, server_hostname=address, https_compatible=True) as secure:
        await secure.do_handshake()
        certificate = secure.getpeercert(True)
    assert certificate is not None
    return Card.read(certificate)


async def newer_shown_by(profile: ClusterProfile, address: str, old: Card) -> Card:
    """Fails if it shows the old one for longer than PATIENCE_S."""
    with trio.fail_after(PATIENCE_S):
        while True:
            shown = await shown_by(profile, address)
            if shown.serial != old.serial:
                return shown
            await trio.sleep(LOOK_S)


# Whoever looks at a certificate only leaves without a word.
@pytest.mark.expect_log("a newcomer: the connection was cut")
async def test_certificates_are_renewed_in_time_and_shown_without_a_restart(tmp_path: Path) -> None:
    profile = made(tmp_path)
    old = {folder: aged(profile, folder, 300 * DAY) for folder in ("nodes/127.0.0.2", "nodes/127.0.0.3", "users/owner")}
    async with nodes_here(tmp_path, 2, profile=profile):
        for address in addresses(2):
            shown = await newer_shown_by(profile, address, old[f"nodes/{address}"])
            assert shown.keys == old[f"nodes/{address}"].keys and shown.not_after > old[f"nodes/{address}"].not_after + 200 * DAY
            # What is shown lies on disk before: a restart shows the same.
            assert Card.read(profile.node_identity(address).certificate) == shown
        async with connect(profile.folder) as cluster:
            mine = Card.read(profile.user_certificate())
            assert mine.not_after > old["users/owner"].not_after + 200 * DAY and mine.keys == old["users/owner"].keys
            assert await cluster.card_of("user:owner") == mine, "the cluster knows the newer one"
            assert (await cluster.nodes())[0].address == "127.0.0.2"
        async with connect(profile.folder):
            assert Card.read(profile.user_certificate()) == mine, "and it is not renewed again"


@pytest.mark.parametrize(
    "years, words", [(1.1, r"valid until 20\d\d-\d\d-\d\d, and this clock says"), (-1, r"valid from 20\d\d-\d\d-\d\d, and this clock says")]
)
async def test_a_clock_that_is_a_year_off_is_told_with_both_dates(tmp_path: Path, years: float, words: str) -> None:
    profile = made(tmp_path, 1)
    for folder in ("nodes/127.0.0.2", "users/owner"):
        aged(profile, folder, years * 365 * DAY)
    with pytest.raises(OutOfDate, match=words):
        async with connect(profile.folder):
            pass
    with pytest.raises(OutOfDate, match=words):
        await run_node(NodeSettings(profile_folder=profile.folder, address="127.0.0.2", data_folder=tmp_path / "data"), extensions=())


async def test_a_cluster_that_slept_for_years_is_woken_with_the_authoritys_key(tmp_path: Path) -> None:
    profile = made(tmp_path, 1)
    old = [aged(profile, folder, 1000 * DAY) for folder in ("nodes/127.0.0.2", "users/owner")]
    renewed = reissue(profile)
    assert [(card.name, card.keys, card.tls_key) for card in renewed] == [(card.name, card.keys, card.tls_key) for card in old]
    async with nodes_here(tmp_path, 1, profile=profile), connect(profile.folder) as cluster:
        assert (await cluster.nodes())[0].address == "127.0.0.2"
        assert [card.name for card in (await cluster.membership.roll()).users] == ["user:owner"]


async def test_a_first_node_that_ran_under_a_wrong_clock_is_woken_without_the_authoritys_key_file(tmp_path: Path) -> None:
    profile = made(tmp_path, 1)
    (profile.folder / "authority" / "key.pem").unlink()
    certificate = profile.folder / "nodes" / "127.0.0.2" / "certificate.pem"
    ahead = read_authority(profile).certify(
        (card := Card.read(certificate.read_bytes())).name,
        list(card.addresses),
        card.tls_key,
        keys=card.keys,
        now=datetime.datetime.now(datetime.UTC) + 300 * DAY,
    )
    write_secret(certificate, ahead, replace=True)
    with pytest.raises(OutOfDate, match="valid from"):
        await run_node(NodeSettings(profile_folder=profile.folder, address="127.0.0.2", data_folder=tmp_path / "data"), extensions=())
    reissue(profile)
    async with nodes_here(tmp_path, 1, profile=profile), connect(profile.folder) as cluster:
        assert (await cluster.nodes())[0].address == "127.0.0.2"


def test_only_who_can_open_the_authoritys_key_issues_certificates_anew(tmp_path: Path) -> None:
    profile = made(tmp_path, 2)
    (profile.folder / "authority" / "key.pem").unlink()
    sealed = profile.folder / "nodes" / "127.0.0.2" / "authority.sealed"
    sealed.rename(profile.folder / "nodes" / "127.0.0.3" / "authority.sealed")
    with pytest.raises(DamagedData):
        reissue(profile)
    (profile.folder / "nodes" / "127.0.0.3" / "authority.sealed").unlink()
    with pytest.raises(LocalFault, match="does not hold the authority's key"):
        reissue(profile)


async def test_a_certificate_of_another_cluster_is_told_so(tmp_path: Path) -> None:
    profile, other = made(tmp_path / "ours", 1), made(tmp_path / "theirs", 1)
    theirs = other.folder / "users" / "owner"
    for name in ("certificate.pem", "key.pem"):
        write_secret(profile.folder / "users" / "owner" / name, (theirs / name).read_bytes(), replace=True)
    with pytest.raises(NotOfThisCluster, match="of another cluster"):
        async with connect(profile.folder):
            pass
