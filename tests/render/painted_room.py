"""A small room of painted walls under a lamp, with a block in it, as files and as records."""

from __future__ import annotations

from pathlib import Path

ROOM = """\
mtllib room.mtl
v -1 -1 1
v 1 -1 1
v 1 -1 -1
v -1 -1 -1
v -1 1 1
v 1 1 1
v 1 1 -1
v -1 1 -1
v -0.4 0.98 0.4
v 0.4 0.98 0.4
v 0.4 0.98 -0.4
v -0.4 0.98 -0.4
v -0.3 -1 -0.3
v 0.5 -1 -0.2
v 0.1 0.2 -0.4
v 0.2 -1 0.4
usemtl white
f 1 2 3 4
f 5 8 7 6
f 4 3 7 8
usemtl red
f 1 4 8 5
usemtl green
f 2 6 7 3
usemtl lamp
f 9 12 11 10
usemtl white
f 13 14 15
f 14 16 15
f 16 13 15
"""
MATERIALS = """\
newmtl white
Kd 0.73 0.73 0.73
newmtl red
Kd 0.63 0.06 0.05
newmtl green
Kd 0.14 0.45 0.09
newmtl lamp
Kd 0.3 0.3 0.3
Ke 12 9 5
"""


CORNER = "v 0.1 0.2 -0.4"
"""The block's highest."""


def write_room(folder: Path, block: str = CORNER) -> Path:
    """Its files in a folder; that of the scene. `block`: the line of the corner at which its block ends above."""
    (folder / "room.mtl").write_text(MATERIALS)
    scene = folder / "room.obj"
    scene.write_text(ROOM.replace(CORNER, block))
    return scene
