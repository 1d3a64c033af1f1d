"""If this fails, edited kernels go on running as they were compiled before, or programs start slowly."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from scenefold.base import kernel_cache
from scenefold.base.kernel_cache import are_compiled, kernels_hash, note_compiled, use_kernel_cache


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of its own, and no numba yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    return tmp_path / "scenefold" / "kernels"


def package(folder: Path) -> Path:
    """A package of a kernels module, a module that it takes a constant from, and one that it knows nothing of."""
    (folder / "room").mkdir(parents=True)
    (folder / "room" / "my_kernels.py").write_text("from scenefold.room.numbers import (\n    ONE,\n)\nfrom scenefold import other\n")
    (folder / "room" / "numbers.py").write_text("ONE = 1\n")
    (folder / "other.py").write_text("")
    (folder / "room" / "apart.py").write_text("")
    return folder


def test_the_hash_changes_with_kernels_and_what_they_import(tmp_path: Path) -> None:
    sources = package(tmp_path)
    seen = {kernels_hash(sources)}
    for name in ("room/my_kernels.py", "room/numbers.py", "other.py"):
        with (sources / name).open("a") as file:
            file.write("# edited\n")
        seen.add(kernels_hash(sources))
    assert len(seen) == 4
    (sources / "room" / "apart.py").write_text("# edited\n")
    assert kernels_hash(sources) in seen


def test_the_hash_is_of_contents_not_of_places(tmp_path: Path) -> None:
    assert kernels_hash(package(tmp_path / "a")) == kernels_hash(package(tmp_path / "b"))


def test_numba_is_pointed_to_a_private_folder(home: Path) -> None:
    folder = use_kernel_cache()
    assert folder == home / kernels_hash()
    assert os.environ["NUMBA_CACHE_DIR"] == str(folder)
    assert folder.stat().st_mode & 0o077 == 0


def test_that_all_are_compiled_is_known_of_one_state_only(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    note_compiled()
    assert not are_compiled(), "nothing was chosen"
    folder = use_kernel_cache()
    assert not are_compiled()
    note_compiled()
    assert are_compiled()
    monkeypatch.setattr(kernel_cache, "kernels_hash", lambda: "edited")
    assert not are_compiled(), f"{folder} may be the user's own, and hold several states"


def test_what_the_user_chose_stays(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/elsewhere")
    assert use_kernel_cache() is None
    assert os.environ["NUMBA_CACHE_DIR"] == "/elsewhere"


def test_a_parent_process_of_another_state_does_not_decide(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(home / "0123"))
    assert use_kernel_cache() == home / kernels_hash()


def test_too_late_is_told_by_none(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", sys)
    assert use_kernel_cache() is None
    assert os.environ["NUMBA_CACHE_DIR"] == ""


def test_where_nothing_can_be_written_a_temporary_folder_serves(home: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    home.parent.write_text("a file where a folder should be")
    caplog.set_level("INFO", "scenefold.kernels")
    folder = use_kernel_cache()
    assert folder is not None
    try:
        assert folder.is_dir()
        assert tmp_path not in folder.parents
        assert "cannot be kept" in caplog.text
    finally:
        folder.rmdir()


def test_a_folder_that_others_may_write_to_is_not_trusted(home: Path) -> None:
    ours = home / kernels_hash()
    ours.mkdir(parents=True)
    ours.chmod(0o777)
    folder = use_kernel_cache()
    assert folder not in (None, ours)
    assert folder is not None
    folder.rmdir()


def test_old_states_are_pruned_but_for_a_few_and_young_ones(home: Path) -> None:
    home.mkdir(parents=True)
    for age in range(8):
        folder = home / f"old{age}"
        folder.mkdir()
        (folder / "code.nbc").write_bytes(b"")
        os.utime(folder, (1e9 - age, 1e9 - age))
    (home / "young").mkdir()
    use_kernel_cache()
    assert {folder.name for folder in home.iterdir()} == {kernels_hash(), "young", "old0", "old1"}


def test_numba_keeps_our_kernels_there(home: Path) -> None:
    code = (
        "from scenefold.base.kernel_cache import use_kernel_cache; use_kernel_cache(); "
        "from scenefold.render.film_kernels import add_pass; import numba; print(numba.config.CACHE_DIR, add_pass._cache.cache_path)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    folder, place = done.stdout.split()
    assert folder == str(home / kernels_hash())
    assert place.startswith(folder)


def test_all_kernels_are_known() -> None:
    hashed = kernel_cache._SOURCES.rglob("*kernels*.py")
    assert {"shade_kernels.py", "cast_kernels.py", "voronoi_kernels.py", "arc_kernels.py"} <= {path.name for path in hashed}
