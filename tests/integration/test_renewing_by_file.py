"""If this fails, who comes back from an old backup has good keys and no way into the cluster (docs/how-to/keep-your-keys.md)."""

from __future__ import annotations

import datetime
import shutil
from pathlib import Path

import pytest

from integration.scenectl_process import Done, running, scenectl
from loopback import ports_option
from scenefold.crypto import Card
from scenefold.crypto.secrets_on_disk import write_secret
from scenefold.world.log_file import LOG_FILE
from scenefold.world.profile import ClusterProfile

ADDRESSES = ("127.0.0.2", "127.0.0.3")
LONG_AGO = datetime.timedelta(days=400)
PASSPHRASE = "correct horse battery"

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
"""Some twenty commands, each a process."""


def test_whoever_comes_back_too_late_goes_on_with_the_same_keys(tmp_path: Path) -> None:
    words = tmp_path / "words.txt"
    words.write_text(PASSPHRASE)
    with running("node", "local", "2", "--folder", tmp_path / "trial", "--ports", ports_option(*ADDRESSES), "--json") as (_, ready):
        office, laptop, new = ready["profile"], tmp_path / "ada", tmp_path / "new"

        def ada(*arguments: str | Path, stdin: bytes = b"") -> Done:
            return scenectl(*arguments, profile=new if new.exists() else laptop, stdin=stdin, SCENEFOLD_PASSPHRASE=PASSPHRASE)

        done(ada("cluster", "join", done(scenectl("cluster", "invite", "--user", "ada", "--json", profile=office)).json["token"]))
        done(ada("scene", "create", "hers"))
        done(ada("data", "put", "files", "0a", "-", "--scene", "hers", stdin=b"a plan"))
        age(ClusterProfile.load(Path(office)), laptop / "users" / "ada" / "certificate.pem")
        done(ada("key", "backup", tmp_path / "keys.txt", "--passphrase-file", words))
        shutil.rmtree(laptop)

        done(scenectl("key", "import", tmp_path / "keys.txt", "--passphrase-file", words, profile=new))
        keys = done(ada("key", "show", "--json")).json
        assert "scenectl cluster renew FILE" in ada("scene", "list").refusal(1)

        sent, own = tmp_path / "ada.pem", new / "users" / "ada" / "certificate.pem"
        shutil.copy(own, sent)
        assert [one["name"] for one in done(scenectl("cluster", "renew", sent, "--json", profile=office)).json["renewed"]] == ["user:ada"]
        shutil.copy(sent, own)

        renewed = done(ada("key", "show", "--json")).json
        assert renewed["not_after"] > keys["not_after"]
        assert all(renewed[key] == keys[key] for key in ("signing_fingerprint", "sealing_fingerprint"))
        assert [scene["name"] for scene in done(ada("scene", "list", "--json")).json["scenes"]] == ["hers"]
        assert done(ada("data", "get", "files", "0a", "--scene", "hers")).out == b"a plan"
        done(ada("data", "put", "files", "5f", "-", "--scene", "hers", stdin=b"another"))

        done(scenectl("scene", "create", "kitchen", profile=office))
        done(scenectl("scene", "grant", "kitchen", "user:ada", "--role", "writer", "--card", sent, profile=office))
        done(ada("data", "put", "files", "0a", "-", "--scene", "kitchen", stdin=b"hers, too"))

        done(scenectl("cluster", "revoke", "user:ada", profile=office))
        known, kept = Path(office) / LOG_FILE, sent.read_bytes()
        assert "is revoked" in scenectl("cluster", "renew", sent, profile=office).refusal(1) and sent.read_bytes() == kept
        # Who has the authority's key and never heard of it can issue one all the same, which opens nothing.
        known.unlink()
        done(scenectl("cluster", "renew", sent, profile=office))
        shutil.copy(sent, own)
        assert "is revoked" in ada("scene", "list").err
        done(scenectl("scene", "create", "garden", profile=office))
        granting = scenectl("scene", "grant", "garden", "user:ada", "--card", sent, profile=office)
        assert "is revoked" in granting.refusal(1)
        assert "user:ada" not in done(scenectl("scene", "access", "garden", profile=office)).out.decode()


def age(profile: ClusterProfile, place: Path) -> None:
    """Let a certificate be as if it had been issued long ago."""
    card = Card.read(place.read_bytes())
    then = datetime.datetime.now(datetime.UTC) - LONG_AGO
    write_secret(place, profile.authority().certify(card.name, list(card.addresses), card.tls_key, keys=card.keys, now=then), replace=True)


def done(found: Done) -> Done:
    assert found.code == 0, found.err
    return found
