"""What the gallery shows: each scene with who made it, under which licence, and how it is rendered (tools/gallery.py)."""

from __future__ import annotations

from dataclasses import dataclass

CORNELL, SKY = "gallery-output/cornell.glb", "gallery-output/sky.hdr"
"""What tools/gallery.py makes itself."""
SIZE = (320, 180)


@dataclass(frozen=True, slots=True)
class GalleryScene:
    title: str
    file: str
    """Beside the checkout, or within the folder of scenes if `is_shared`."""
    author: str
    licence: str
    options: str
    """Of `scenectl render still`, beside file, size and output."""
    zoom: float = 1.0
    """For who is small in the view of a camera that nobody chose: the image is the middle of one that is so much larger."""
    is_shared: bool = True

    @property
    def slug(self) -> str:
        """What its image is called."""
        return self.title.lower().replace(" ", "-").replace("'", "")

    def command(self, scenes: str, output: str) -> list[str]:
        """The words behind `scenectl`."""
        file = f"{scenes}/{self.file}" if self.is_shared else self.file
        size = [*self._framed(), *self.options.split()]
        return ["render", "still", file, *size, "--output", f"{output}/{self.slug}.exr"]

    def _framed(self) -> list[str]:
        width, height = SIZE
        whole_width, whole_height = round(width * self.zoom), round(height * self.zoom)
        size = ["--size", f"{whole_width}x{whole_height}"]
        if self.zoom == 1.0:
            return size
        return [*size, "--crop", f"{(whole_width - width) // 2},{(whole_height - height) // 2},{width},{height}"]


OURS = "this project"
KHRONOS = "Khronos Group and contributors"

SHOWN = (
    GalleryScene("Sample", "src/scenefold/data/sample.glb", OURS, "Apache-2.0", "--samples 256", is_shared=False),
    GalleryScene("Cornell box", CORNELL, f"{OURS}, after the Cornell program of computer graphics", "Apache-2.0", "--samples 256", is_shared=False),
    GalleryScene(
        "BMW 27", "bmw27/bmw27.glb", "Mike Pan", "CC BY or CC0: sources differ", "--samples 256 --camera Camera --sky 0.37,0.44,0.5"
    ),
    GalleryScene("Breakfast room", "dining_room/dining_room.glb", "Wig42; converted by Benedikt Bitterli", "CC BY 3.0", "--samples 512 --depth 12 --sky 30,30,30 --exposure 0.4"),
    GalleryScene(
        "Japanese classroom", "japanese_classroom/japanese_classroom.glb", "NovaZeeke; converted by Benedikt Bitterli", "CC BY 3.0",
        "--samples 512 --depth 12 --sky 6,6,6 --exposure -1.6",
    ),
    GalleryScene("Barcelona pavilion", "barcelona_pavilion/barcelona_pavilion.glb", "eMirage", "CC BY 3.0", "--samples 64 --camera Overview --sky 350,480,700"),
    GalleryScene("Inside the pavilion", "barcelona_pavilion/barcelona_pavilion.glb", "eMirage", "CC BY 3.0", "--samples 64 --camera Interior --sky 350,480,700"),
    GalleryScene("San Miguel", "san_miguel/san_miguel.glb", "Guillermo M. Leal Llaguno", "CC BY 3.0", "--samples 48 --camera Camera20 --sky 3,4,5"),
    GalleryScene("Spot", "spot/spot.obj", "Keenan Crane", "CC0 1.0", f"--samples 64 --environment {SKY} --exposure -1.2"),
    GalleryScene("Fox", "Fox/Fox.glb", "PixelMannen, tomkranis, AsoboStudio and scurest", "CC0 1.0; rig and animation CC BY 4.0", f"--samples 64 --animation Run --time 0.3 --environment {SKY} --exposure -0.5", zoom=1.75),
    GalleryScene("Clear coats", "ClearCoatTest/ClearCoatTest.glb", KHRONOS, "CC BY 4.0", f"--samples 64 --environment {SKY} --exposure -0.4"),
    GalleryScene("Transmission", "TransmissionTest/TransmissionTest.glb", KHRONOS, "CC0 1.0", f"--samples 64 --environment {SKY} --exposure -0.5"),
)  # fmt: skip

LEFT_OUT = {
    "helicopter": "its licence could not be established",
    "stanford_bunny": "no commercial use without permission",
    "CesiumMan": "its licence has limits for the trademark that it wears",
}
"""Scenes of the folder that are not published, and why."""
