"""If this fails, somebody cannot lock, back up or recover keys as docs/how-to/keep-your-keys.md says."""

from __future__ import annotations

import getpass
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from scenectl import passphrases as asking
from scenectl.program import main
from scenefold.crypto import passphrases
from scenefold.world.profile import ClusterProfile

PASSPHRASE = "four random words here"


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passphrases, "LOG2_N", 4)
    monkeypatch.setattr(asking, "_typed", {})
    monkeypatch.delenv(asking.VARIABLE, raising=False)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ClusterProfile.create(tmp_path_factory.mktemp("profiles") / "studio", "studio", ["127.0.0.2"]).folder


@pytest.fixture
def profile(original: Path, tmp_path: Path) -> Path:
    shutil.copytree(original, tmp_path / "studio")
    return tmp_path / "studio"


@pytest.fixture
def word(tmp_path: Path) -> Path:
    (tmp_path / "word").write_text(PASSPHRASE + "\n")
    return tmp_path / "word"


def _json(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Any:
    capsys.readouterr()
    code = main([*map(str, arguments), "--json"])
    return {"exit_code": code, **json.loads(capsys.readouterr().out)}


def _shown(capsys: pytest.CaptureFixture[str], profile: Path) -> Any:
    shown = _json(capsys, "key", "show", "-p", profile)
    return {name: value for name, value in shown.items() if name not in ("folder", "locked")}


def test_keys_are_backed_up_and_recovered_as_the_docs_say(
    profile: Path, word: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = _shown(capsys, profile)
    assert before["exit_code"] == 0 and before["user"] == "owner" and before["administrator"]
    written = _json(capsys, "key", "backup", tmp_path / "keys.txt", "--passphrase-file", word, "-p", profile)
    assert (written["kind"], written["users"], written["authority_key"]) == ("backup", ["owner"], True)
    shutil.rmtree(profile)
    back = _json(capsys, "key", "import", tmp_path / "keys.txt", "--passphrase-file", word, "-p", profile)
    assert back["exit_code"] == 0 and back["profile"] == str(profile)
    monkeypatch.setenv(asking.VARIABLE, PASSPHRASE)
    assert _shown(capsys, profile) == before
    assert main(["key", "passphrase", "--remove", "-p", str(profile)]) == 0
    monkeypatch.delenv(asking.VARIABLE)
    assert _shown(capsys, profile) == before


def test_an_identity_works_on_another_computer_and_admits_nobody(
    profile: Path, word: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = _shown(capsys, profile)
    written = _json(capsys, "key", "export", tmp_path / "me.txt", "--passphrase-file", word, "-p", profile)
    assert (written["kind"], written["scenes"], written["authority_key"]) == ("identity", 0, False)
    assert _json(capsys, "key", "import", tmp_path / "me.txt", "--passphrase-file", word, "-p", tmp_path / "laptop")["exit_code"] == 0
    monkeypatch.setenv(asking.VARIABLE, PASSPHRASE)
    assert _shown(capsys, tmp_path / "laptop") == before


def test_no_secret_is_shown(profile: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["key", "show", "-p", str(profile)]) == 0
    shown = capsys.readouterr().out
    assert "owner" in shown and "administrator" in shown and "ed25519-aes192gcm" in shown
    secrets = ClusterProfile.load(profile).user_secrets()
    for secret in (secrets.signing.seed, secrets.sealing.seed):
        assert secret.hex() not in shown and secret.hex()[:16] not in shown.replace(" ", "")


class Person:
    """Types these answers at a terminal."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *answers: str) -> None:
        self.left = list(answers)
        self.asked: list[str] = []
        monkeypatch.setattr(asking, "_is_person_there", lambda: True)
        monkeypatch.setattr(getpass, "getpass", self._type)

    def _type(self, prompt: str, stream: Any = None) -> str:
        assert stream is sys.stderr, "results alone go to standard output"
        self.asked.append(prompt)
        return self.left.pop(0)


def test_a_person_is_asked_twice_for_a_new_passphrase_and_once_for_a_known_one(
    profile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    person = Person(monkeypatch, PASSPHRASE, PASSPHRASE)
    assert main(["key", "passphrase", "-p", str(profile)]) == 0
    assert [prompt.split()[0] for prompt in person.asked] == ["New", "Once"]
    capsys.readouterr()
    person = Person(monkeypatch, PASSPHRASE)
    assert _json(capsys, "key", "show", "-p", profile)["locked"]
    assert len(person.asked) == 1


def test_two_different_new_passphrases_change_nothing(
    profile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Person(monkeypatch, PASSPHRASE, "something else now")
    assert main(["key", "passphrase", "-p", str(profile)]) == 2
    assert "not the same" in capsys.readouterr().err
    assert not (profile / "users" / "owner" / "locked").exists()


def test_who_does_not_know_the_present_passphrase_sets_no_new_one(
    profile: Path, word: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["key", "passphrase", "--passphrase-file", str(word), "-p", str(profile)]) == 0
    person = Person(monkeypatch, "a wrong passphrase")
    assert main(["key", "passphrase", "-p", str(profile)]) == 1
    assert "the passphrase is wrong" in capsys.readouterr().err and len(person.asked) == 1


def test_a_command_that_speaks_to_the_cluster_asks_outside_of_trio_and_goes_on(
    profile: Path, word: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import trio

    from scenectl.running import connected, run

    assert main(["key", "passphrase", "--passphrase-file", str(word), "-p", str(profile)]) == 0
    person = Person(monkeypatch, PASSPHRASE)
    typing = person._type

    def outside(prompt: str, stream: Any = None) -> str:
        with pytest.raises(RuntimeError):
            trio.lowlevel.current_task()
        return typing(prompt, stream)

    monkeypatch.setattr(getpass, "getpass", outside)

    async def work() -> str:
        async with connected(str(profile)) as cluster:
            return cluster.name

    assert run(work) == "studio" and len(person.asked) == 1
    assert run(work) == "studio" and len(person.asked) == 1, "it is remembered for the process"


MISTAKES = {
    "locked, nobody to ask": (["key", "show"], "these keys are locked, and no passphrase was given", 2),
    "a short passphrase": (["key", "backup", "TMP/b.txt", "--passphrase-file", "TMP/short"], "8 to 1024 characters", 2),
    "no passphrase": (["key", "backup", "TMP/b.txt"], "no passphrase was given", 2),
    "no such file": (["key", "import", "TMP/none", "--passphrase-file", "TMP/word"], "cannot read the file", 1),
    "no file of keys": (["key", "import", "TMP/word", "--passphrase-file", "TMP/word"], "holds no keys", 1),
    "no such user": (["key", "show", "--user", "ada"], "no keys of a user ada", 1),
    "a passphrase that is no text": (["key", "backup", "TMP/b.txt", "--passphrase-file", "TMP/binary"], "no text in UTF-8", 1),
    "a target that exists": (["key", "backup", "TMP/word", "--passphrase-file", "TMP/word"], "exists already", 1),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_one_line_and_changes_nothing(
    case: str, profile: Path, word: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "short").write_text("short\n")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\xff\xfe\xff\xfe\xff\xfe")
    assert main(["key", "passphrase", "--passphrase-file", str(word), "-p", str(profile)]) == 0
    capsys.readouterr()
    if case != "locked, nobody to ask":
        monkeypatch.setenv(asking.VARIABLE, PASSPHRASE)
    arguments, message, code = MISTAKES[case]
    before = sorted(path.name for path in tmp_path.rglob("*"))
    assert main([argument.replace("TMP", str(tmp_path)) for argument in arguments] + ["-p", str(profile)]) == code
    complaint = capsys.readouterr().err
    assert message in complaint and complaint.startswith("error: ") and complaint.count("\n") == 1
    assert sorted(path.name for path in tmp_path.rglob("*")) == before
