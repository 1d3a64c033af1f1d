"""If this fails, a folder that cannot serve is answered by words that do not say what to do."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from scenectl.program import main


def test_a_file_is_no_folder_of_a_local_cluster(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "note").write_text("mine")
    assert main(["node", "local", "1", "--folder", str(tmp_path / "note")]) == 1
    assert capsys.readouterr().err == f"error: the folder cannot be used: Not a directory ({tmp_path}/note): choose another folder\n"


def test_a_folder_is_no_scene_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["render", "still", str(tmp_path)]) == 1
    assert capsys.readouterr().err == f"error: that is a folder ({tmp_path}): name a scene file in it\n"


def test_who_has_not_the_authoritys_key_is_told_who_renews(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    profile = tmp_path / "studio"
    assert main(["cluster", "init", str(profile), "--nodes", "127.0.0.2"]) == 0
    (profile / "authority" / "key.pem").unlink()
    capsys.readouterr()
    assert main(["cluster", "renew", "--profile", str(profile)]) == 0, "it is sealed to the node whose keys are here"
    assert "node:127.0.0.2 " in capsys.readouterr().out
    shutil.rmtree(profile / "nodes")
    assert main(["cluster", "renew", "--profile", str(profile)]) == 1
    remedy = "call this where the cluster was made, or with the first node's profile"
    assert capsys.readouterr().err == f"error: the profile does not hold the authority's key ({profile}): {remedy}\n"
