"""The gallery's page of the documentation, from the list of its scenes."""

from __future__ import annotations

from pathlib import Path

from gallery_scenes import LEFT_OUT, SHOWN

PAGE = Path("docs/gallery.md")
_HEAD = """\
# Gallery

![Twelve scenes, each rendered by a cluster](images/gallery.png)

`make gallery` renders these again, each with the command below; `make gallery SCENES=folder` says where the scenes lie that are not the
project's own (usually in `../shared/scenes`). Those belong to who made them, and are shown here under the licences that they gave.
Unless its command says otherwise an image has the exposure that it asks for, and the view transform AgX. `gallery-output/sky.hdr` is an environment map
that the target makes: a blue sky with a low sun.
"""
_LICENCES = """\
[Apache-2.0](https://www.apache.org/licenses/LICENSE-2.0) ·
[CC0 1.0](https://creativecommons.org/publicdomain/zero/1.0/) ·
[CC BY 3.0](https://creativecommons.org/licenses/by/3.0/) ·
[CC BY 4.0](https://creativecommons.org/licenses/by/4.0/).
They were changed in this: other programs converted them to glTF, and some lost textures, plants or finer levels of detail on the way.
"""


def page() -> str:
    """The whole of it."""
    lines = [_HEAD, "| scene | made by | licence |", "| --- | --- | --- |"]
    lines += [f"| {scene.title} | {scene.author} | {scene.licence} |" for scene in SHOWN]
    lines += ["", _LICENCES, "## Commands", "", "```sh"]
    lines += [f"scenectl {' '.join(scene.command('../shared/scenes', 'gallery-output'))}" for scene in SHOWN]
    lines += ["```", "", "## Left out", "", "Other scenes that the project is tested with are not published:", ""]
    lines += [f"- `{name}`: {why}." for name, why in LEFT_OUT.items()]
    return "\n".join(lines) + "\n"
