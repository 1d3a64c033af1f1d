"""If this fails, keys of a killed `init` or `join` lie on the disk in the clear for good, or one loses what another is just writing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault
from scenefold.client.own_keys import own_keys, set_passphrase
from scenefold.crypto import InvitedKind, Token, mark_of, passphrases
from scenefold.crypto.drafts import LOCK_FILE, new_file, new_folder
from scenefold.crypto.secret_folder import LOCKED_FILE, SecretFolder
from scenefold.world.folder_lock import alone_in
from scenefold.world.leftovers import draft_of, sweep_profile
from scenefold.world.newcomer import Newcomer, write_party
from scenefold.world.profile import ClusterProfile

PASSPHRASE = "four random words here"
DYING = """
import os, signal, sys
from pathlib import Path
from scenefold.client.own_keys import set_passphrase
from scenefold.crypto import Token, passphrases
from scenefold.world.newcomer import Newcomer, write_party
from scenefold.world.profile import ClusterProfile
passphrases.LOG2_N = 4
place = Path(sys.argv[1])
def die_at(owner, step, when):
    whole = getattr(owner, step)
    def dying(*args, **named):
        if when(*args):
            os.kill(os.getpid(), signal.SIGKILL)
        return whole(*args, **named)
    setattr(owner, step, dying)
"""


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passphrases, "LOG2_N", 4)


@pytest.fixture
def profile(tmp_path: Path) -> Path:
    return ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"]).folder


def killed(place: Path, *lines: str) -> None:
    """Another process does this, and is killed on the way."""
    done = subprocess.run([sys.executable, "-c", "\n".join((DYING, *lines)), str(place)], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr


def hidden(folder: Path) -> list[str]:
    """Drafts and what lies in them."""
    return sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.name != LOCK_FILE and any(part.startswith(".") for part in path.relative_to(folder).parts)
    )


def told(_where: str) -> str:
    return PASSPHRASE


def token_for(profile: Path) -> Token:
    known = ClusterProfile.load(profile)
    return Token(InvitedKind.USER, b"t" * 32, mark_of(known.authority_certificate()), 0, known.ports.low, known.ports.high, ())


INIT = "ClusterProfile.create(place, 'studio', ['127.0.0.2'])"


@pytest.mark.parametrize(
    "step",
    [
        "die_at(Path, 'rename', lambda path, *_: path.name.startswith('.studio.'))",
        "die_at(os, 'link', lambda draft, place: place.name == 'log.seed')",
        "die_at(os, 'fsync', lambda handle: os.readlink(f'/proc/self/fd/{handle}').endswith('authority'))",
    ],
)
def test_the_keys_of_a_killed_init_go_with_the_next_one(tmp_path: Path, step: str) -> None:
    killed(tmp_path / "studio", step, INIT)
    assert any(name.endswith("authority/key.pem") for name in hidden(tmp_path)) and not (tmp_path / "studio").exists()
    ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])
    assert hidden(tmp_path) == []


def test_they_go_with_a_passphrase_too(tmp_path: Path) -> None:
    killed(tmp_path / "studio", "die_at(Path, 'rename', lambda path, *_: path.name.startswith('.studio.'))", INIT)
    (draft,) = tmp_path.glob(".studio.*")
    draft.rename(tmp_path / "kept")
    ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])
    (tmp_path / "kept").rename(draft)
    set_passphrase(tmp_path / "studio", None, lambda: PASSPHRASE, told)
    assert hidden(tmp_path) == []


@pytest.mark.parametrize(
    "step", ["die_at(Path, 'rename', lambda *_: True)", "die_at(os, 'link', lambda draft, place: place.name == 'key.pem')"]
)
def test_keys_that_a_killed_join_had_begun_to_make_go_with_the_next_one(profile: Path, tmp_path: Path, step: str) -> None:
    token = token_for(profile)
    killed(tmp_path / "mine", step, f"Newcomer.at(place, Token.read({token.word()!r}))")
    assert any(name.endswith(".seed") for name in hidden(tmp_path))
    newcomer = Newcomer.at(tmp_path / "mine", token)
    assert not newcomer.asked_before and len(list(tmp_path.glob(".mine.*"))) == 1
    newcomer.forget()
    assert hidden(tmp_path) == []


def test_a_member_whose_folder_a_killed_join_had_begun_is_written_whole(profile: Path) -> None:
    party = """
owner = ClusterProfile.load(place)
identity = owner.authority().issue("user:ada", [], keys=owner.user_secrets().public())
die_at(Path, "rename", lambda *_: True)
write_party(place, identity, owner.user_secrets())
"""
    killed(profile, party)
    assert any("users/.ada." in name for name in hidden(profile))
    known = ClusterProfile.load(profile)
    write_party(profile, known.authority().issue("user:ada", [], keys=known.user_secrets().public()), known.user_secrets())
    assert hidden(profile) == [] and known.user_identity("ada").name == "user:ada"


def locked(profile: Path) -> Path:
    set_passphrase(profile, None, lambda: PASSPHRASE, told)
    return profile / "users" / "owner"


REMOVED = "set_passphrase(place, None, None, lambda _: 'four random words here')"


def test_keys_that_were_plain_for_a_moment_go_when_the_folder_is_opened(profile: Path) -> None:
    owner = locked(profile)
    killed(profile, "die_at(Path, 'replace', lambda path, *_: 'sealing' in path.name)", REMOVED)
    assert [name for name in hidden(owner) if name.startswith(".sealing.seed.")]
    own_keys(profile, None, told)
    assert hidden(owner) == [] and sorted(path.name for path in owner.iterdir()) == [LOCK_FILE, "certificate.pem", LOCKED_FILE]


def test_a_draft_beside_plain_keys_neither_hinders_a_passphrase_nor_outlives_it(profile: Path) -> None:
    owner = profile / "users" / "owner"
    step = "die_at(Path, 'unlink', lambda path, *_: '.signing.seed.' in path.name)"
    killed(
        profile,
        "(place / 'users/owner/signing.seed').unlink()",
        step,
        "ClusterProfile.load(place).node_secrets('127.0.0.2').to_files(place / 'users/owner')",
    )
    assert len(hidden(owner)) == 1
    set_passphrase(profile, None, lambda: PASSPHRASE, told)
    assert hidden(owner) == [] and sorted(path.name for path in owner.iterdir()) == [LOCK_FILE, "certificate.pem", LOCKED_FILE]


def test_a_file_that_cannot_be_locked_is_named(profile: Path) -> None:
    (profile / "users" / "owner" / "signing (copy).seed").write_text("of a key")
    with pytest.raises(LocalFault, match=r"cannot be locked: signing \(copy\)"):
        set_passphrase(profile, None, lambda: PASSPHRASE, told)


def test_what_a_living_process_writes_stays(tmp_path: Path) -> None:
    with draft_of(tmp_path / "studio") as draft, draft_of(tmp_path / "studio", ".import") as other:
        (draft / "key.pem").touch()
        ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])
        assert (draft / "key.pem").exists() and other.exists()
    assert hidden(tmp_path) == []
    owner = locked(tmp_path / "studio")
    with new_file(owner / "certificate.pem") as (file, _), new_folder(owner) as folder:
        own_keys(tmp_path / "studio", None, told)
        set_passphrase(tmp_path / "studio", None, lambda: PASSPHRASE, told)
        assert file.exists() and folder.exists()


def test_who_opens_the_folder_removes_no_keys_that_another_is_just_making_plain(profile: Path) -> None:
    owner = locked(profile)
    with alone_in(owner):
        (owner / "signing.seed").write_bytes(b"about to be what counts")
        own_keys(profile, None, told)
        assert (owner / "signing.seed").exists()
    own_keys(profile, None, told)
    assert not (owner / "signing.seed").exists()


def test_another_process_has_to_wait_before_it_changes_the_passphrase(profile: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    owner = locked(profile)
    monkeypatch.setattr("scenefold.world.folder_lock.LOOK_S", 0.0)
    for wanted in (None, lambda: PASSPHRASE):
        with alone_in(owner), pytest.raises(LocalFault, match="is not done"):
            set_passphrase(profile, None, wanted, told)
    assert SecretFolder(owner).is_locked


def test_links_and_what_others_own_are_never_followed_or_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / ".studio.0123456789ab").symlink_to(tmp_path / "elsewhere")
    (tmp_path / ".studio.ba9876543210").mkdir()
    with monkeypatch.context() as other:
        other.setattr(os, "geteuid", lambda: 12345)
        sweep_profile(tmp_path / "studio")
    assert (tmp_path / ".studio.ba9876543210").exists()
    sweep_profile(tmp_path / "studio")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".studio.0123456789ab", "elsewhere"]
