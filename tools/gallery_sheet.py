"""The gallery's contact sheet: tiles in rows, each with its title under it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gallery_scenes import SIZE
from PIL import Image, ImageDraw, ImageFont

SHEET = Path("docs/images/gallery.png")
COLUMNS, GAP, LABEL = 4, 8, 22
"""Tiles in a row; pixels between tiles, and for a title."""
_PAPER, _INK = (24, 24, 26), (225, 225, 225)


def write_sheet(tiles: Sequence[tuple[str, Path]], path: Path) -> None:
    """Titles and images, row by row."""
    width, height = SIZE
    rows = -(-len(tiles) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * (width + GAP) + GAP, rows * (height + LABEL + GAP) + GAP), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for number, (title, image) in enumerate(tiles):
        left, top = GAP + number % COLUMNS * (width + GAP), GAP + number // COLUMNS * (height + LABEL + GAP)
        with Image.open(image) as tile:
            sheet.paste(tile.resize(SIZE, Image.Resampling.LANCZOS), (left, top))
        draw.text((left + 2, top + height + LABEL // 2), title, _INK, font, anchor="lm")
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path, optimize=True)
