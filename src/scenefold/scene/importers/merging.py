"""Files with more materials than a triangle's number tells apart (specs/05-scene-content.md, Importing).

What no triangle wears is left out, and materials that differ in their name alone become one, under the name of the first.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.materials import Material

MERGED = "materials that differ from others in their name alone, merged"
USE = re.compile(r"^[ \t]*usemtl[ \t]+(.*)$", re.MULTILINE)
_FACE = re.compile(r"^[ \t]*f[ \t]", re.MULTILINE)


def look_of(material: Material) -> Material:
    """All of a material but its name: equal for two that no image tells apart."""
    return replace(material, name="")


def with_fewer_names(text: str, known: Mapping[str, Material], instead: Material, left: NotCarried) -> str:
    """The text of an OBJ that names the first of those that look alike, and none that no face wears.

    `instead` is worn by faces whose material is not known.
    """
    before, *pieces = USE.split(text)
    parts = [before]
    names: dict[str, str] = {}
    first: dict[Material, str] = {}
    for name, lines in zip((words.strip() for words in pieces[::2]), pieces[1::2], strict=True):
        if _FACE.search(lines):
            if name not in names:
                names[name] = first.setdefault(look_of(known.get(name, instead)), name)
            parts.append(f"usemtl {names[name]}")
        parts.append(lines)
    left.note(MERGED, len(names) - len(first))
    return "".join(parts)
