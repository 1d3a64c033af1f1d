"""Renders the gallery of the documentation: a contact sheet, and the page that says whose scenes these are.

    python tools/gallery.py --scenes ../shared/scenes [--only spot,fox] [--anew]

Each scene is rendered by a cluster of its own, with the command that the page names, into gallery-output/; what is there already is taken
as it is, unless all are to be made anew; how many nodes there are makes no difference to it. What is left out is said, and why. Without all scenes neither sheet nor page is touched.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from gallery_page import PAGE, page
from gallery_scenes import CORNELL, LEFT_OUT, SHOWN, SKY, GalleryScene
from gallery_sheet import SHEET, write_sheet
from gallery_sky import write_sky

from scenefold.scene.cornell import cornell_box

ROOT = Path(__file__).resolve().parent.parent
OUTPUT = "gallery-output"


def main() -> int:
    options = _options()
    os.chdir(ROOT)
    Path(OUTPUT).mkdir(exist_ok=True)
    Path(CORNELL).write_bytes(cornell_box())
    write_sky(Path(SKY))
    for name, why in LEFT_OUT.items():
        print(f"left out: {name}: {why}")
    wanted = [scene for scene in SHOWN if not options.only or scene.slug in options.only.split(",")]
    missing = [scene for scene in wanted if not _made(scene, options)]
    if missing or len(wanted) < len(SHOWN):
        print(f"{SHEET} and {PAGE} stay as they are: they show all {len(SHOWN)} scenes, or nothing new")
        return 1 if missing else 0
    write_sheet([(scene.title, Path(OUTPUT) / f"{scene.slug}.png") for scene in SHOWN], SHEET)
    PAGE.write_text(page(), encoding="utf-8")
    print(f"{SHEET} and {PAGE} are written")
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--scenes", default="../shared/scenes", help="the folder of scenes that are not the project's own")
    parser.add_argument("--only", default="", help="names of images, with commas between")
    parser.add_argument("--nodes", type=int, default=5, help="of each cluster")
    parser.add_argument("--anew", action="store_true", help="also what was rendered before")
    return parser.parse_args()


def _made(scene: GalleryScene, options: argparse.Namespace) -> bool:
    """Whether its image is there, rendered now if need be."""
    image, command = Path(OUTPUT) / f"{scene.slug}.png", scene.command(options.scenes, OUTPUT)
    if not Path(command[2]).is_file():
        print(f"left out: {scene.title}: there is no {command[2]}")
        return False
    if image.is_file() and not options.anew:
        return True
    print(f"rendering {scene.title}", flush=True)
    nodes = ["--nodes", str(options.nodes)]
    done = subprocess.run([sys.executable, "-m", "scenectl", *command, *nodes], stdout=subprocess.DEVNULL, check=False)
    if done.returncode:
        print(f"left out: {scene.title}: `scenectl {' '.join(command)}` failed")
    return not done.returncode


if __name__ == "__main__":
    sys.exit(main())
