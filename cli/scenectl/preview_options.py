"""Options for pictures of a render on its way: `render still` and `render watch` have the same."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.output import note
from scenectl.values import real

if TYPE_CHECKING:
    from scenefold.render.preview_files import Previews

EVERY_S = 10.0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PreviewOptions:
    """Without a file there are none."""

    preview: Path | None = None
    "PNG file that shows what the image looks like so far, written anew all the while."
    preview_every: Annotated[float | None, real(gte=1, lte=86_400)] = None
    "With --preview: seconds from one picture to the next, by default 10."

    def checked(self, where: str, view: str = "agx") -> Previews | None:
        """What was asked for. UsageFault if that cannot be; LocalFault if nothing can be written there."""
        from scenefold.base.errors import UsageFault
        from scenefold.render.image_files import check_writable
        from scenefold.render.preview_files import Previews

        if self.preview is None:
            if self.preview_every is not None:
                raise UsageFault("--preview-every goes with --preview", where=where, remedy="name a file for it, or leave it out")
            return None
        if self.preview.suffix.lower() != ".png":
            raise UsageFault("a preview is a PNG file", where=f"--preview {self.preview}", remedy="give it a name that ends in .png")
        check_writable(self.preview)
        every_s = EVERY_S if self.preview_every is None else self.preview_every
        return Previews(self.preview, every_s, view, missed=lambda why: note(f"note: there are no previews at present: {why}"))


NO_PREVIEWS = PreviewOptions()
