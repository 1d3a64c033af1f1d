"""Finding Mitsuba and choosing its variant: the one place where it is imported, and late, for it takes its time.

`llvm_ad_rgb` traces wavefronts on all cores and needs a system's LLVM; `scalar_rgb` goes ray by ray through Python,
is a thousand times slower, and is there for very small images. DRJIT_LIBLLVM_PATH names an LLVM that is not found by itself.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib
import importlib.util
import os
import threading
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from scenefold.base.errors import LocalFault

WAVEFRONT_VARIANT = "llvm_ad_rgb"
SCALAR_VARIANT = "scalar_rgb"
_PATH_VARIABLE = "DRJIT_LIBLLVM_PATH"
_LIBRARIES = Path("/usr/lib/x86_64-linux-gnu")
LLVM_LEAST = 17
"""Older ones end the process ("Cannot select") over what Dr.Jit asks of processors with AVX-512: the lesser of two numbers, or NaN."""
_lock = threading.Lock()


class Mitsuba(NamedTuple):
    """The two modules, with the variant set."""

    mi: Any
    dr: Any
    variant: str

    @property
    def is_wavefront(self) -> bool:
        """Whether a call takes many rays at once."""
        return self.variant != SCALAR_VARIANT


def is_installed() -> bool:
    """Whether Python finds the package; it is not imported."""
    return importlib.util.find_spec("mitsuba") is not None


@cache
def llvm_library() -> str:
    """The path or name of an LLVM that serves Dr.Jit, the newest first; empty if there is none."""
    named = os.environ.get(_PATH_VARIABLE, "")
    installed = [path for path in _LIBRARIES.glob("libLLVM*.so*") if _version_of(path) >= LLVM_LEAST]
    candidates = [named, *(str(path) for path in sorted(installed, key=_version_of, reverse=True)), ctypes.util.find_library("LLVM") or ""]
    return next((candidate for candidate in candidates if candidate and _serves(candidate)), "")


def _version_of(path: Path) -> int:
    """19 of libLLVM.so.19.1, libLLVM-19.so and libLLVM-19.so.1; 0 if the name tells none."""
    digits = "".join(sign if sign.isdigit() else " " for sign in path.name).split()
    return int(digits[0]) if digits else 0


def _serves(library: str) -> bool:
    """Whether it can be loaded, and says itself that it is new enough, whatever its name; those before 16 cannot say it."""
    try:
        tell = ctypes.CDLL(library).LLVMGetVersion
    except (OSError, AttributeError):
        return False
    major, minor, patch = ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint()
    tell(ctypes.byref(major), ctypes.byref(minor), ctypes.byref(patch))
    return major.value >= LLVM_LEAST


def load() -> Mitsuba:
    """Mitsuba with its variant set; LocalFault if it is not installed."""
    with _lock:
        return _load()


@cache
def _load() -> Mitsuba:
    if not is_installed():
        raise LocalFault("Mitsuba is not installed", remedy="install it: pip install 'scenefold[mitsuba]'")
    llvm = llvm_library()
    if llvm:
        os.environ[_PATH_VARIABLE] = llvm
    mi: Any = importlib.import_module("mitsuba")
    variant = WAVEFRONT_VARIANT if llvm else SCALAR_VARIANT
    mi.set_variant(variant)
    return Mitsuba(mi, importlib.import_module("drjit"), variant)
