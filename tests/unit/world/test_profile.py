"""If this fails, a cluster's keys are lost, exposed, mixed up, or half-written by `cluster init`."""

from __future__ import annotations

import shutil
import stat
from dataclasses import replace
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import KeyId, address_of
from scenefold.crypto import ED25519, RSA3072, Card
from scenefold.wire import Lockbox
from scenefold.world import Ports
from scenefold.world.keyring import KeptScene, Keyring
from scenefold.world.profile import ClusterProfile

ADDRESSES = ["127.0.0.4", "127.0.0.2", "127.0.0.3"]
SPARES = ["127.0.0.1", "127.0.0.6"]
EVERYBODY = sorted(ADDRESSES + SPARES)


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> ClusterProfile:
    folder = tmp_path_factory.mktemp("profiles") / "studio"
    return ClusterProfile.create(folder, "studio", ADDRESSES, spares=SPARES, ports=Ports(20001, 20002))


def keys_of(name: str, first: int = 1) -> KeptScene:
    return KeptScene(name, bytes([first] * 32), KeyId(7), 3, Lockbox(KeyId(9), b"sealed" * 30, bytes(64)))


def test_what_is_created_is_what_is_loaded(profile: ClusterProfile) -> None:
    assert ClusterProfile.load(profile.folder) == profile
    assert profile.ports == Ports(20001, 20002)
    assert [member.address for member in profile.members] == EVERYBODY


def test_founders_stand_on_the_line_and_spares_have_credentials_only(profile: ClusterProfile) -> None:
    facts = profile.facts()
    assert [address_of(node) for node in facts.founders] == sorted(ADDRESSES)
    assert [credential.address for credential in facts.credentials] == EVERYBODY
    assert [address_of(node) for node in facts.voters] == ["127.0.0.2"], "the first of the founders, not of all nodes"
    assert profile.seeds == tuple(sorted(ADDRESSES)), "a spare is nobody to look for"


def test_whom_the_cluster_trusts_from_its_start_is_said_when_it_is_made(profile: ClusterProfile, tmp_path: Path) -> None:
    assert profile.facts().trusted == (), "besides the voter, nobody"
    trusting = ClusterProfile.create(tmp_path / "farm", "farm", ADDRESSES, spares=SPARES, trust_all=True)
    assert [address_of(node) for node in trusting.facts().trusted] == [address for address in EVERYBODY if address != "127.0.0.2"]
    assert ClusterProfile.load(trusting.folder) == trusting


def test_only_the_voter_can_sign_the_log(profile: ClusterProfile) -> None:
    key = profile.log_signing_key("127.0.0.2")
    assert key is not None and key.public == profile.log_key
    assert profile.log_signing_key("127.0.0.3") is None and profile.log_signing_key("127.0.0.6") is None
    assert [path.parent.name for path in profile.folder.rglob("log.seed")] == ["127.0.0.2"]


def test_the_log_of_a_cluster_has_a_name_that_its_key_gives(profile: ClusterProfile) -> None:
    header = profile.facts().genesis_header
    assert header.scene == int.from_bytes(header.genesis[:4], "big") and header.with_genesis() == header
    assert header == ClusterProfile.load(profile.folder).facts().genesis_header
    assert replace(profile.facts(), log_key=profile.user_secrets().signing.public).genesis_header.scene != header.scene


def test_another_key_for_the_log_is_noticed(tmp_path: Path) -> None:
    profile = ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])
    folder = profile.folder / "nodes" / "127.0.0.2"
    (folder / "signing.seed").replace(folder / "log.seed")
    with pytest.raises(LocalFault, match="not the key of this cluster's log"):
        profile.log_signing_key("127.0.0.2")


def test_every_party_has_keys_of_its_own(profile: ClusterProfile) -> None:
    names = [profile.node_identity(address).name for address in EVERYBODY]
    assert names == [f"node:{member.node_id}" for member in profile.members]
    assert profile.user_identity().name == "user:owner"
    secrets = [profile.node_secrets(address) for address in EVERYBODY] + [profile.user_secrets()]
    assert len({seed for one in secrets for seed in (one.signing.seed, one.sealing.seed)}) == 2 * (len(EVERYBODY) + 1)
    cards = [Card.verified(profile.node_identity(address).certificate, profile.authority_certificate()) for address in EVERYBODY]
    assert [card.keys for card in cards] == [one.public() for one in secrets[:-1]]
    owner = Card.verified(profile.user_identity().certificate, profile.authority_certificate())
    assert owner.keys == secrets[-1].public(is_administrator=True), "who makes a cluster administers it"


def test_the_user_may_have_keys_of_another_suite_and_nodes_have_not(tmp_path: Path) -> None:
    made = ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"], suite=RSA3072)
    own = made.user_secrets()
    assert (own.signing.suite, own.sealing.suite) == (RSA3072, RSA3072)
    assert sorted(path.name for path in made.user_folder().glob("s*")) == ["sealing.pem", "signing.pem"]
    card = Card.verified(made.user_identity().certificate, made.authority_certificate())
    assert card.keys == own.public(is_administrator=True)
    assert made.node_secrets("127.0.0.2").signing.suite == ED25519


def test_a_machine_needs_no_more_than_its_part(profile: ClusterProfile, tmp_path: Path) -> None:
    machine = tmp_path / "machine"
    for part in ("cluster.toml", "authority/certificate.pem", f"nodes/{ADDRESSES[1]}"):
        source, target = profile.folder / part, machine / part
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(source, target) if source.is_dir() else shutil.copy(source, target)
    own = ClusterProfile.load(machine)
    assert own.node_secrets(ADDRESSES[1]).signing.public == own.member(ADDRESSES[1]).public_key
    assert own.node_identity(ADDRESSES[1]) and own.authority_certificate()
    assert {path.name for path in profile.folder.iterdir()} == {"cluster.toml", "authority", "nodes", "users", "scenes"}


def test_nobody_else_may_read_it(profile: ClusterProfile) -> None:
    profile.keyring.save(keys_of("private"))
    for path in profile.folder.rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0, path


def test_an_existing_cluster_is_not_overwritten(profile: ClusterProfile) -> None:
    before = {path: path.read_bytes() for path in profile.folder.rglob("*") if path.is_file()}
    with pytest.raises(LocalFault, match="exists already"):
        ClusterProfile.create(profile.folder, "other", ADDRESSES)
    assert before == {path: path.read_bytes() for path in profile.folder.rglob("*") if path.is_file()}


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(LocalFault, match="taken by something else"):
        ClusterProfile.create(tmp_path, "studio", ADDRESSES)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


@pytest.mark.parametrize(
    "addresses, what",
    [
        ([], "0 nodes"),
        (["127.0.0.2", "127.0.0.2"], "twice"),
        (["not.an.address"], "no IPv4 address"),
        (["1.2.3"], "no IPv4 address"),
        *((["127.0.0.2", nobody], "not the address of one machine") for nobody in ("0.0.0.0", "0.1.2.3", "224.0.0.1", "255.255.255.255")),
    ],
)
def test_bad_addresses_leave_nothing_behind(tmp_path: Path, addresses: list[str], what: str) -> None:
    with pytest.raises(LocalFault, match=what):
        ClusterProfile.create(tmp_path / "studio", "studio", addresses)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "x" * 65, "-option"])
def test_names_are_file_names(tmp_path: Path, profile: ClusterProfile, name: str) -> None:
    with pytest.raises(LocalFault, match="cannot be the name"):
        ClusterProfile.create(tmp_path / "studio", name, ADDRESSES)
    with pytest.raises(LocalFault, match="cannot be the name"):
        profile.keyring.load(name)


def test_equal_ports_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="no two ports"):
        ClusterProfile.create(tmp_path / "studio", "studio", ADDRESSES, ports=Ports(5000, 5000))


def test_no_profile_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="no cluster profile"):
        ClusterProfile.load(tmp_path / "nowhere")


@pytest.mark.parametrize(
    "content",
    [b"", b"\xff\xfe", b"format = 4", b"format = 4\nname = 3", b"format =", b'format = 4\nname = "x"\ncluster_id = "00"\nmembers = []'],
)
def test_a_damaged_file_is_one_clear_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "cluster.toml").write_bytes(content)
    with pytest.raises(LocalFault, match="damaged"):
        ClusterProfile.load(tmp_path)


@pytest.mark.parametrize("number, remedy", [(1, "cluster init"), (3, "cluster init"), (5, "the program that wrote it")])
def test_a_file_of_another_version_says_so(tmp_path: Path, number: int, remedy: str) -> None:
    (tmp_path / "cluster.toml").write_text(f"format = {number}")
    with pytest.raises(LocalFault, match=rf"format {number}, .*this program.* knows format 4") as caught:
        ClusterProfile.load(tmp_path)
    assert remedy in caught.value.remedy


@pytest.mark.parametrize("line", ["founders = [1]", "voters = []", "voters = [2130706435, 2130706434]", 'log_key = "00"', "trusted = [1]"])
def test_founders_voters_and_key_that_cannot_be_are_one_clear_error(tmp_path: Path, line: str) -> None:
    profile = ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2", "127.0.0.3"], trust_all=True)
    path = profile.folder / "cluster.toml"
    name = line.partition(" ")[0]
    path.write_text("\n".join(line if text.startswith(name) else text for text in path.read_text().splitlines()))
    with pytest.raises(LocalFault, match="damaged"):
        ClusterProfile.load(profile.folder)


def test_a_missing_key_file_is_named(tmp_path: Path) -> None:
    profile = ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])
    (profile.folder / "nodes" / "127.0.0.2" / "signing.seed").unlink()
    with pytest.raises(LocalFault, match="missing") as caught:
        profile.node_secrets("127.0.0.2")
    assert "signing.seed" in caught.value.where


def test_another_nodes_seed_is_noticed(tmp_path: Path) -> None:
    profile = ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2", "127.0.0.3"], trust_all=True)
    nodes = profile.folder / "nodes"
    (nodes / "127.0.0.3" / "signing.seed").replace(nodes / "127.0.0.2" / "signing.seed")
    with pytest.raises(LocalFault, match="not the keys that are registered"):
        profile.node_secrets("127.0.0.2")


def test_a_stranger_is_no_member(profile: ClusterProfile) -> None:
    with pytest.raises(LocalFault, match="is no node of this cluster"):
        profile.node_identity("127.0.0.9")


def test_the_one_spare_with_keys_here_is_meant(tmp_path: Path) -> None:
    spares = ["127.0.0.4", "127.0.0.5", "127.0.0.6"]
    profile = ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2", "127.0.0.3"], spares=spares)
    nodes = profile.folder / "nodes"

    def problem(besides: str = "127.0.0.2") -> tuple[str, str | None]:
        with pytest.raises(UsageFault) as caught:
            profile.spare_here(besides=besides)
        assert caught.value.where == str(nodes)
        return caught.value.what, caught.value.remedy

    assert problem() == ("keys of several spares are here", f"choose with --address, of {', '.join(spares)}")
    shutil.rmtree(nodes / "127.0.0.5")
    assert problem()[1] == "choose with --address, of 127.0.0.4, 127.0.0.6"
    assert profile.spare_here(besides="127.0.0.6") == "127.0.0.4"
    shutil.rmtree(nodes / "127.0.0.4")
    assert profile.spare_here(besides="127.0.0.2") == "127.0.0.6"
    shutil.rmtree(nodes / "127.0.0.6")
    assert problem() == ("no keys of a spare are here", f"copy the folder of one of {', '.join(spares)} there")
    alone = ClusterProfile.create(tmp_path / "alone", "alone", ["127.0.0.2"])
    with pytest.raises(UsageFault, match="no keys of a spare are here") as caught:
        alone.spare_here(besides="127.0.0.2")
    assert "--spares" in str(caught.value.remedy)


def test_what_is_kept_of_a_scene_never_goes_back(tmp_path: Path) -> None:
    keyring = Keyring(tmp_path / "scenes")
    keyring.advance(keys_of("kitchen"))
    assert keyring.names() == [], "what was removed meanwhile does not come back"
    keyring.save(keys_of("kitchen"))
    newer = replace(keys_of("kitchen"), position=2**64 - 1, key_epoch=4)
    for kept in (newer, replace(newer, position=7, key_epoch=5), keys_of("kitchen"), replace(keys_of("kitchen", 2), position=2**64 - 1)):
        keyring.advance(kept)
        assert keyring.load("kitchen") == newer
    path = tmp_path / "scenes" / "kitchen.toml"
    path.write_text("".join(line for line in path.read_text().splitlines(True) if not line.startswith(("position", "# SHA"))))
    assert keyring.load("kitchen").position == 0, "of an earlier program"


def test_a_scene_is_kept_and_found_again(profile: ClusterProfile) -> None:
    profile.keyring.save(keys_of("kitchen"))
    assert profile.keyring.load("kitchen") == keys_of("kitchen")
    assert "kitchen" in profile.keyring.names()
    assert profile.keyring.load("kitchen").scene_id == 0x01010101


def test_a_scenes_keys_are_not_shown(profile: ClusterProfile) -> None:
    assert "ssss" not in repr(keys_of("kitchen")) and "hhhh" not in repr(keys_of("kitchen"))


def test_another_scene_of_the_same_name_is_refused(profile: ClusterProfile) -> None:
    profile.keyring.save(keys_of("hall", first=1))
    with pytest.raises(LocalFault, match="exists already"):
        profile.keyring.save(keys_of("hall", first=2))
    assert profile.keyring.load("hall") == keys_of("hall", first=1)


def test_keys_of_another_scene_under_this_name_are_noticed(profile: ClusterProfile) -> None:
    profile.keyring.save(keys_of("attic"))
    path = profile.folder / "scenes" / "attic.toml"
    path.write_text(path.read_text().replace("id = 16843009", "id = 7"))
    with pytest.raises(LocalFault, match="damaged"):
        profile.keyring.load("attic")
