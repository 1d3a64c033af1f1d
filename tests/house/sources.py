"""The project's own files, for the tests that look at all of them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE_ROOTS = {"scenefold": ROOT / "src", "scenectl": ROOT / "cli"}
FOLDERS = ("src", "cli", "tests", "tools", "benchmarks", "typings", "docs", "specs", "examples", "changes.d", ".ci", ".github")
TEXT = {".py", ".pyi", ".md", ".toml", ".txt", ".yml", ".yaml", ".cfg", ".sh", ".css", ".js", ".html", ""}


def text_files() -> Iterator[Path]:
    """Every text file that belongs to the project."""
    tops = [path for path in ROOT.iterdir() if path.is_file() and path.name != ".git"]
    below = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    for path in sorted([*tops, *below]):
        if path.suffix in TEXT and not {"__pycache__", ".mypy_cache", "node_modules"} & set(path.parts):
            yield path


def python_files(*folders: str) -> Iterator[Path]:
    """Python files below these folders of the project."""
    for folder in folders:
        yield from sorted(path for path in (ROOT / folder).rglob("*.py") if "__pycache__" not in path.parts)


def module_of(path: Path) -> str:
    """scenefold.wire.codec for src/scenefold/wire/codec.py; a package is named by its folder."""
    for root in PACKAGE_ROOTS.values():
        if path.is_relative_to(root):
            parts = path.relative_to(root).with_suffix("").parts
            return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
    raise ValueError(f"{path} lies in no package")


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Every module that a file imports anywhere, late imports and type-checking ones included."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return frozenset(found)


def lies_in(module: str, *packages: str) -> bool:
    """Whether a module is one of these packages or lies below one."""
    return any(module == package or module.startswith(f"{package}.") for package in packages)
