"""If this fails, Mitsuba gets an LLVM that ends the process over its code, or none although a new one is there."""

from __future__ import annotations

import ctypes.util
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from scenefold.render.renderers.mitsuba import library

CC = shutil.which("gcc") or shutil.which("cc")
pytestmark = pytest.mark.skipif(CC is None, reason="no C compiler, with which to make libraries that stand for LLVMs")


@pytest.fixture(autouse=True)
def nothing_known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    monkeypatch.setattr(library, "_LIBRARIES", tmp_path)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(ctypes.util, "find_library", lambda _name: None)
    library.llvm_library.cache_clear()
    yield
    library.llvm_library.cache_clear()


def made(path: Path, major: int | None) -> str:
    """A library that says it is this LLVM; None: one of before they could say it."""
    tells = f"void LLVMGetVersion(unsigned *major, unsigned *minor, unsigned *patch) {{ *major = {major}; *minor = 1; *patch = 7; }}"
    source = path.with_suffix(".c")
    source.write_text("int nothing;\n" if major is None else tells)
    subprocess.run([str(CC), "-shared", "-fPIC", "-o", str(path), str(source)], check=True, timeout=60)
    return str(path)


def test_the_newest_is_taken_by_what_it_says(tmp_path: Path) -> None:
    made(tmp_path / "libLLVM-15.so.1", None)
    made(tmp_path / "libLLVM-16.so.1", 16)
    made(tmp_path / "libLLVM.so.18.1", 18)
    newest = made(tmp_path / "libLLVM.so.19.1", 19)
    assert library.llvm_library() == newest


@pytest.mark.parametrize("major", [None, 14, library.LLVM_LEAST - 1])
def test_one_that_would_end_the_process_is_not_taken_whatever_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, major: int | None
) -> None:
    made(tmp_path / "libLLVM.so.20.1", major)
    old = made(tmp_path / "libLLVM.so", major)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", old)
    monkeypatch.setattr(ctypes.util, "find_library", lambda _name: old)
    assert library.llvm_library() == ""


def test_what_is_named_goes_before_what_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made(tmp_path / "libLLVM.so.19.1", 19)
    named = made(tmp_path / "elsewhere.so", library.LLVM_LEAST)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", named)
    assert library.llvm_library() == named


def test_what_is_no_library_is_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "libLLVM.so.21.1").write_text("no library")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "not-there.so"))
    assert library.llvm_library() == ""
    library.llvm_library.cache_clear()
    found = made(tmp_path / "libLLVM.so.17.0", 17)
    assert library.llvm_library() == found
