"""If this fails, a user whose keys are RSA cannot do what others can, or is refused beside them."""

from __future__ import annotations

from pathlib import Path

import pytest

from integration.scenectl_process import running, scenectl
from loopback import ports_option

RSA = ("--suite", "rsa3072-aes192gcm")

pytestmark = pytest.mark.slow


def test_a_user_with_rsa_keys_writes_reads_grants_and_is_granted(tmp_path: Path) -> None:
    folder, mine = tmp_path / "trial", tmp_path / "mine"
    with running("node", "local", "2", "--folder", folder, "--ports", ports_option("127.0.0.2", "127.0.0.3"), "--json") as (_, ready):
        owner = ready["profile"]

        def token(*options: str) -> str:
            return str(scenectl("cluster", "invite", *options, "--json", profile=owner).json["token"])

        refused = scenectl("cluster", "join", token("--node"), *RSA, "--address", "127.0.0.9", profile=tmp_path / "node")
        assert refused.code == 2 and "a node's keys are of ed25519" in refused.error
        joined = scenectl("cluster", "join", token("--user", "ada"), *RSA, profile=mine)
        assert joined.code == 0, joined.err
        assert {path.name for path in (mine / "users" / "ada").glob("s*")} == {"signing.pem", "sealing.pem"}

        assert scenectl("scene", "create", "attic", profile=mine).code == 0
        assert scenectl("data", "put", "files", "a1", "-", "--scene", "attic", profile=mine, stdin=b"by rsa").code == 0
        assert scenectl("data", "get", "files", "a1", "--scene", "attic", profile=mine).out == b"by rsa"
        granted = scenectl("scene", "grant", "attic", "user:owner", "--role", "writer", profile=mine)
        assert granted.code == 0, granted.err
        assert scenectl("data", "get", "files", "a1", "--scene", "attic", profile=owner).out == b"by rsa"
        assert scenectl("data", "put", "files", "a2", "-", "--scene", "attic", profile=owner, stdin=b"by ed25519").code == 0
        assert scenectl("data", "get", "files", "a2", "--scene", "attic", profile=mine).out == b"by ed25519"
