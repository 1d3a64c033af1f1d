"""If this fails, who looks at a damaged disk is told nothing, or something else to scripts than to people."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from scenectl.program import main
from scenefold.store.layout import HOLDING, RECORDS, STATISTICS
from unit.peer.checking.folders_made import COUNT, SCENE, filled, key, rot


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


async def test_a_folder_in_which_all_is_well(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    await filled(tmp_path)
    assert main(["node", "verify", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert f"Node 127.0.0.2: {COUNT} records, " in said.out and f"{COUNT} signatures looked at; nothing damaged." in said.out
    assert f"records: {COUNT} of {COUNT}" in said.err
    assert main(["node", "repair", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("0 mended.\n")


async def test_what_is_damaged_is_named_with_what_helps(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    await filled(tmp_path)
    rot(tmp_path, STATISTICS, key(0)[:6])
    rot(tmp_path, RECORDS, key(7), 300)
    assert main(["node", "verify", str(tmp_path)]) == 5
    text = capsys.readouterr().out
    assert "2 damaged" in text and f"1 can be made anew: scenectl node repair {tmp_path}\n" in text
    assert f"  records, scene {SCENE.scene:08x}, space 10, " in text and "1 the node gets from other nodes once it runs" in text
    assert main(["node", "repair", str(tmp_path), "--dry-run"]) == 5
    text = capsys.readouterr().out
    assert text.startswith("1 would be mended.\n  statistics, scene ") and "1 the node gets from other nodes once it runs" in text
    assert main(["node", "repair", str(tmp_path)]) == 5
    text = capsys.readouterr().out
    assert text.startswith("1 mended.\n") and "1 damaged" in text and "node repair" not in text


async def test_scripts_are_told_the_same(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    await filled(tmp_path)
    rot(tmp_path, STATISTICS, key(0)[:6])
    rot(tmp_path, RECORDS, key(7), 300)
    assert main(["node", "verify", str(tmp_path), "--json", "--no-signatures"]) == 5
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert said.err == ""
    assert (told["node"], told["boot"], told["records"], told["signatures"]) == ("127.0.0.2", 1, COUNT, 0)
    assert (told["sound"], told["fetch"], told["mend"], told["wipe"], told["left_out"]) == (False, 1, 1, 0, 0)
    assert [(found["table"], found["helps"]) for found in told["findings"]] == [("records", "fetch"), ("statistics", "mend")]
    assert main(["node", "repair", str(tmp_path), "--json"]) == 5
    done = json.loads(capsys.readouterr().out)
    assert (done["dry_run"], done["mended"], [found["table"] for found in done["done"]]) == (False, 1, ["statistics"])
    assert (done["after"]["fetch"], done["after"]["mend"]) == (1, 0)


async def test_what_cannot_be_mended_is_said_with_what_to_do(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    await filled(tmp_path)
    rot(tmp_path, HOLDING, b"arc", 5)
    rot(tmp_path, STATISTICS, key(0)[:6])
    assert main(["node", "repair", str(tmp_path)]) == 5
    text = capsys.readouterr().out
    assert text.startswith("0 mended.\n") and "1 cannot be mended: see to the disk, then wipe the folder" in text
    assert "node repair" not in text and "1 could be made anew, but for that" in text
    assert main(["node", "repair", str(tmp_path), "--dry-run"]) == 5
    text = capsys.readouterr().out
    assert text.startswith("0 would be mended.\n") and "holding, arc: " in text and "1 cannot be mended: see to the disk" in text


@pytest.mark.parametrize("verb", ["verify", "repair"])
@pytest.mark.parametrize("how", ["garbage", "empty", "zeros", "100 bytes", "a page", "both first pages"])
async def test_a_file_that_was_written_over_or_cut_off_is_damage_and_stays_as_it_is(
    how: str, verb: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    await filled(tmp_path)
    data = tmp_path / "data.mdb"
    whole = data.read_bytes()
    noise = random.Random(1).randbytes(300_000)
    (tmp_path / "scenefold.lock").unlink()
    (tmp_path / "lock.mdb").unlink()
    data.write_bytes(
        {"garbage": noise, "empty": b"", "zeros": bytes(300_000), "100 bytes": whole[:100], "a page": whole[:4096]}.get(
            how, noise[:8192] + whole[8192:]
        )
    )
    before = data.read_bytes()
    assert main(["node", verb, str(tmp_path)]) == 5
    told = capsys.readouterr()
    assert told.err == "" and "the tree: " in told.out and "cannot be mended: see to the disk, then wipe the folder" in told.out
    assert names(tmp_path) == ["data.mdb"] and data.read_bytes() == before
    assert main(["node", verb, str(tmp_path), "--json"]) == 5
    document = json.loads(capsys.readouterr().out)
    assert (document["after"] if verb == "repair" else document)["wipe"] >= 1


@pytest.mark.parametrize("verb", ["verify", "repair"])
def test_a_folder_without_a_store(verb: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["node", verb, str(tmp_path)]) == 1
    wanted = f"error: there is no store ({tmp_path}): give the folder that the node is run with (`--data`)\n"
    assert capsys.readouterr().err == wanted
    assert list(tmp_path.iterdir()) == []
