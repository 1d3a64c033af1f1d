"""Options that say what an image shall be: `render still` and `render start` have the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from scenectl.image_values import USUAL_LAYERS, CropOption, LayersOption, check_camera
from scenectl.values import ColourOption, PoolsOption, SizeOption, real, whole
from scenefold.base.image_limits import CLAMP_MAX, DEPTH_MAX, EXPOSURE_MAX, MIN_SAMPLES_LEAST, ROTATION_MAX, SAMPLES_MAX

if TYPE_CHECKING:
    from scenefold.render.client import StillOptions


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ImageOptions:
    """What is not given is as the scene says, or else as usual."""

    algorithm: str | None = None
    "How cells move, by default bounded-radial: vivaldi, no-certainty, swarming, no-backtracking, voxelised-swarming, planar, radial, bounded-radial, power, kd; voronoi never do; whole: no cells, each node holds the whole scene."
    fixed_cells: Annotated[bool, Parameter(negative="", show_default=False)] = False
    "Leave the cells where they are at first."
    pools: PoolsOption | None = None
    "In how many pools the nodes render; each pool holds the whole scene and passes rays on among its own nodes only, so more of them take more memory and less time. auto: as many as the nodes have memory for, as by default, unless --algorithm, --fixed-cells or --skip-empty is given: then 1."
    skip_empty: Annotated[bool, Parameter(negative="", show_default=False)] = False
    "Pass rays over cells in which they meet nothing: nodes send each other fewer rays, in more and smaller packets. For slow networks between many nodes."
    samples: Annotated[int | None, whole(1, SAMPLES_MAX)] = None
    "Paths for each pixel, by default 64, or as many as the scene says."
    adaptive: Annotated[float | None, real(gt=0, lte=1)] = None
    "Stop early where the expected error is this share of a pixel's brightness, as 0.05; --samples are then the most."
    min_samples: Annotated[int | None, whole(MIN_SAMPLES_LEAST, SAMPLES_MAX)] = None
    "With --adaptive: paths that every pixel has before any stops, by default 16."
    size: SizeOption | None = None
    "Width and height in pixels, by default 640x360, or as the scene says."
    scale: Annotated[float, real(gt=0, lte=1)] = 1.0
    "For a preview: make the image so much smaller, as 0.25."
    crop: CropOption | None = None
    "Make only this part of the image: X,Y,WIDTH,HEIGHT in its pixels, from the upper left corner; it is equal to that part of the whole."
    seed: Annotated[int, whole(0, 2**32 - 1)] = 1
    "Seed of the random numbers; the same seed gives the same image."
    depth: Annotated[int | None, whole(1, DEPTH_MAX)] = None
    "Most segments of a path, the camera ray being the first; by default 8, or as the scene says."
    sky: ColourOption | None = None
    "Colour of a uniform sky as R,G,B, linear; without it, and unless the scene says one, only the scene's own lights shine."
    environment_rotation: Annotated[float | None, real(gte=-ROTATION_MAX, lte=ROTATION_MAX)] = None
    "Degrees by which the scene's environment map is turned about the vertical axis, counter-clockwise seen from above."
    camera: str | None = None
    "Name of the camera; by default the one that the scene says, or its default one."
    aperture: Annotated[float | None, real(gt=0, lte=1e9)] = None
    "Radius of the camera's lens in the scene's unit: what is nearer or farther than the focus is blurred; by default everything is sharp."
    focus: Annotated[float | None, real(gt=0, lte=1e9)] = None
    "How far from the camera everything is sharp, in the scene's unit, measured along the way that it looks; goes with --aperture."
    sampler: Literal["sobol", "independent"] | None = None
    "How the random numbers of a pixel's paths are drawn: sobol, the usual one, spreads them evenly, independent draws each by itself."
    roulette_from: Annotated[int | None, whole(1, DEPTH_MAX)] = None
    "Bounce from which on a path that carries little light may end by chance, by default 3; as large as --depth, and none does."
    clamp_direct: Annotated[float | None, real(gt=0, lte=CLAMP_MAX)] = None
    "Most that one contribution of direct light may be, as the mean of red, green and blue; against fireflies, at the cost of light."
    clamp_indirect: Annotated[float | None, real(gt=0, lte=CLAMP_MAX)] = None
    "The same of light that was reflected more than once; 10 is a usual value."
    mips: bool = True
    "Read far textures from coarser levels, as their file says; --no-mips reads only the finest."
    layers: LayersOption = USUAL_LAYERS
    "What the EXR file holds beside the beauty, some of emission, direct, indirect, albedo, normal, depth, position, object_id, material_id, samples and variance, with commas between; or all, or none."
    exposure: Annotated[float | None, real(gte=-EXPOSURE_MAX, lte=EXPOSURE_MAX)] = None
    "Brightness of the PNG in stops, by default as the scene says, or the image asks; the EXR is not changed."
    ignore_settings: Annotated[bool, Parameter(negative="", show_default=False)] = False
    "Take all that is not given here as usual, whatever the scene says."

    def checked(self, where: str) -> StillOptions:
        """As the client takes them; UsageFault, of the verb `where`, if they contradict each other, or one is out of range."""
        from scenefold.base.errors import UsageFault

        if self.min_samples is not None and self.adaptive is None:
            raise UsageFault("--min-samples counts with --adaptive only", where=where, remedy="give both, or none")
        if self.pools is not None and self.algorithm == "whole":
            what = "with --algorithm whole each node is a pool of its own"
            raise UsageFault(what, where=where, remedy="leave out --pools, or name another algorithm")
        if self.camera is not None:
            check_camera(self.camera)
        from scenefold.render.client import StillOptions
        from scenefold.render.window import Window

        options = StillOptions(
            width=None if self.size is None else self.size.width,
            height=None if self.size is None else self.size.height,
            samples=self.samples,
            seed=self.seed,
            depth=self.depth,
            algorithm=self.algorithm,
            fixed_cells=self.fixed_cells,
            pools=None if self.pools is None else self.pools.count,
            skip_empty=self.skip_empty,
            sky=None if self.sky is None else self.sky.rgb,
            camera=self.camera,
            exposure=self.exposure,
            aperture=self.aperture,
            focus=self.focus,
            environment_rotation=self.environment_rotation,
            sampler=self.sampler,
            roulette_from=self.roulette_from,
            clamp_direct=self.clamp_direct,
            clamp_indirect=self.clamp_indirect,
            mips=self.mips,
            layers=self.layers.names,
            scale=self.scale,
            crop=None if self.crop is None else Window(*self.crop.numbers),
            adaptive=self.adaptive,
            min_samples=self.min_samples,
            ignore_settings=self.ignore_settings,
        )
        options.checked()
        return options


USUAL_IMAGE = ImageOptions()
