"""A job: everything that decides the bits of an image, as one document that all its nodes get (rendering.md).

`RenderOptions` is what a user asks for. The node that organises the job turns it into a `Job`: the scene
and its keys, sealed to those that render, the camera as numbers, the nodes in line order and the partition. The document is
plain values only, packed by the wire's strict codec, so its bytes are equal wherever it is packed.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from typing import Any, Self

from scenefold.base.errors import PeerFault, UsageFault
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.image_limits import DEPTH_MAX, ROTATION_MAX, SAMPLES_MAX, SIDE_MAX, SKY_MAX
from scenefold.base.limits import PASS_PATHS_MAX, PASSES_MAX, POOL_NODES_MAX
from scenefold.base.plain_values import exactly, flag, number, text, whole
from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.render.algorithms import USUAL_ALGORITHM, check_algorithm
from scenefold.render.layers import USUAL, check_layers, columns_of
from scenefold.render.lens import Lens
from scenefold.render.levels import Adaptive
from scenefold.render.passes import PassPlan, plan_of
from scenefold.render.sampling import USUAL_SAMPLING, Sampling
from scenefold.render.sealed_keys import SealedKeys
from scenefold.render.sum_columns import SumColumns
from scenefold.render.window import Window
from scenefold.scene.head import NO_HEAD, SceneHead
from scenefold.wire import pack_value, unpack_value

SEED_MAX = 2**63 - 1
HASH_BYTES = 32
_CAMERA_NUMBERS = 16
POOLS_THAT_FIT = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderOptions:
    """What a user asks of a render. `check()` says what is wrong with it."""

    width: int = 640
    height: int = 360
    samples: int = 64
    """Paths per pixel."""
    seed: int = 1
    depth: int = 8
    """Segments of a path at most, the camera ray being the first."""
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Radiance of the constant environment, linear."""
    camera: str | None = None
    """Name of one of the scene's cameras; None: its default."""
    algorithm: str = USUAL_ALGORITHM
    """How space is divided, and by which rule cells move (`algorithms.ALGORITHMS`)."""
    moving: bool = True
    """Whether cells move while the job is traced; no bit depends on it."""
    layers: tuple[str, ...] = USUAL
    """Beside the beauty."""
    crop: Window | None = None
    """The part of the image to make; None: all of it."""
    lens: Lens | None = None
    """Of the camera; None: it is a pinhole."""
    sampling: Sampling = USUAL_SAMPLING
    environment_rotation: float = 0.0
    """Degrees by which the scene's environment map is turned about +Y, counter-clockwise seen from above."""
    adaptive: Adaptive | None = None
    """When a pixel has fewer samples; None: never."""
    mips: bool = True
    """Whether far textures are read from their coarser levels, as their samplers say; else only the finest ever is."""
    pools: int = 1
    """In how many render pools the nodes stand, each of which holds the whole scene (specs/36-render-pools.md); `POOLS_THAT_FIT`: as many as can be. No bit depends on it."""
    skips: bool = False
    """Whether nodes pass rays over cells in which they meet nothing (specs/28-rebalancing.md, Empty space); no bit depends on it."""

    @property
    def window(self) -> Window:
        """What is made of the image."""
        return self.crop or Window(0, 0, self.width, self.height)

    @property
    def columns(self) -> SumColumns:
        """Of the sums of its passes."""
        return columns_of(self.layers)

    @property
    def plan(self) -> PassPlan:
        """The passes of a job that does this; its id is not known yet."""
        return plan_of(0, self.window.pixels, self.samples, self.adaptive)

    def check(self) -> None:
        """UsageFault naming the first option that is out of range."""
        bounds = (
            ("width", self.width, 1, SIDE_MAX),
            ("height", self.height, 1, SIDE_MAX),
            ("samples", self.samples, 1, SAMPLES_MAX),
            ("seed", self.seed, 0, SEED_MAX),
            ("depth", self.depth, 1, DEPTH_MAX),
            ("pools", self.pools, POOLS_THAT_FIT, POOL_NODES_MAX),
        )
        for name, value, least, most in bounds:
            if not least <= value <= most:
                raise UsageFault(f"{name} is {value}", where=name, remedy=f"give a whole number from {least} to {most}")
        if len(self.sky) != 3 or not all(0.0 <= channel <= SKY_MAX for channel in self.sky):
            raise UsageFault("the sky is no colour", where="sky", remedy="give three numbers from 0 to 1e9, as in 0.5,0.6,0.7")
        check_layers(self.layers)
        self.window.check(self.width, self.height)
        if self.lens is not None:
            self.lens.check()
        self.sampling.check()
        check_rotation(self.environment_rotation)
        if self.adaptive is not None:
            self.adaptive.check()
        check_algorithm(self.algorithm)
        if self.plan.count > PASSES_MAX:
            raise UsageFault(
                f"that many samples of that many pixels are {self.window.pixels * self.samples:,} paths",
                where="samples",
                remedy=f"give fewer, or make a part of the image at a time: {PASSES_MAX * PASS_PATHS_MAX:,} is the most",
            )


def check_rotation(degrees: float) -> None:
    """UsageFault unless a map can be turned by so much."""
    if not -ROTATION_MAX <= degrees <= ROTATION_MAX:
        raise UsageFault(f"the environment's rotation is {degrees}", where="environment-rotation", remedy="give degrees, from -360 to 360")


def layers_of_row(row: Any) -> tuple[str, ...]:
    """Names of layers beside the beauty, as documents have them; ValueError or TypeError for anything else, UsageFault for layers that are none."""
    if not isinstance(row, list):
        raise TypeError("a list of layers is expected")
    names = tuple(text(name) for name in row)
    check_layers(names)
    return names


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A job as its nodes know it."""

    id: int
    scene: SceneId
    genesis: bytes
    keys: SealedKeys
    """Of the scene, for those that the client chose: a node reads the scene for as long as the job lasts."""
    content: bytes
    """Of the scene's tables and records (`SceneDocument.digest`), so that all nodes render the same import or none."""
    numeric_class: str
    width: int
    height: int
    samples: int
    seed: int
    frame: int
    depth: int
    sky: tuple[float, float, float]
    camera: tuple[float, ...]
    """15 numbers as in `JobNumbers.camera`, and a 0."""
    nodes: tuple[NodeId, ...]
    """In line order; a node's index here is its index in the partition."""
    partition: Partition
    """Of the first render pool, which all nodes are in if there is no other."""
    others: tuple[Partition, ...] = ()
    """Of the other pools."""
    head: SceneHead = NO_HEAD
    layers: tuple[str, ...] = USUAL
    """Beside the beauty."""
    crop: Window | None = None
    lens: Lens | None = None
    sampling: Sampling = USUAL_SAMPLING
    environment_rotation: float = 0.0
    adaptive: Adaptive | None = None
    mips: bool = True
    keeps: bool = False
    """Whether its films are kept, so that the nodes tell a digest of what they hold."""
    moves: bool = False
    """Whether its cells may move, so that the nodes tell where rays hit."""
    skips: bool = False
    """Whether its nodes tell where they hold something, and pass rays over what is empty."""

    @property
    def window(self) -> Window:
        """What is made of the image."""
        return self.crop or Window(0, 0, self.width, self.height)

    @property
    def division(self) -> Division:
        """Of space, among all nodes, at first."""
        return Division((self.partition, *self.others))

    def divided(self, division: Division) -> Self:
        """The same job of nodes that stand otherwise."""
        return replace(self, partition=division.pools[0], others=division.pools[1:])

    @property
    def columns(self) -> SumColumns:
        """Of the sums of its passes."""
        return columns_of(self.layers)

    @property
    def plan(self) -> PassPlan:
        """The job's passes."""
        return plan_of(self.id, self.window.pixels, self.samples, self.adaptive)

    def to_bytes(self) -> bytes:
        """The packed document."""
        return pack_value(
            {
                "id": self.id,
                "scene": int(self.scene),
                "genesis": self.genesis,
                "keys": self.keys.row(),
                "content": self.content,
                "numeric_class": self.numeric_class,
                "size": [self.width, self.height],
                "samples": self.samples,
                "seed": self.seed,
                "frame": self.frame,
                "depth": self.depth,
                "sky": struct.pack("<3d", *self.sky),
                "camera": struct.pack(f"<{_CAMERA_NUMBERS}d", *self.camera),
                "nodes": [int(node) for node in self.nodes],
                "partition": self.division.to_document(),
                "head": self.head.row(),
                "layers": list(self.layers),
                "crop": None if self.crop is None else self.crop.row(),
                "lens": None if self.lens is None else self.lens.row(),
                "sampling": self.sampling.row(),
                "environment_rotation": float(self.environment_rotation),
                "adaptive": None if self.adaptive is None else self.adaptive.row(),
                "mips": self.mips,
                "keeps": self.keeps,
                "moves": self.moves,
                "skips": self.skips,
            }
        )

    @classmethod
    def from_bytes(cls, payload: bytes) -> Job:
        """The job of a packed document; PeerFault if it is none."""
        document = unpack_value(payload, what="a job")
        try:
            return cls._from_map(document)
        except (KeyError, TypeError, ValueError, UsageFault, struct.error) as error:
            raise PeerFault("a job's document is ill-formed", where=f"{type(error).__name__}: {error}") from error

    @classmethod
    def _from_map(cls, document: Any) -> Job:
        width, height = (whole(side, 1, SIDE_MAX) for side in document["size"])
        if flag(document.get("whole", False)):
            raise ValueError("its organiser runs an older version")
        division = Division.from_document(document["partition"])
        job = cls(
            id=whole(document["id"], 0, 2**64 - 1),
            scene=SceneId(whole(document["scene"], 0, 2**32 - 1)),
            genesis=exactly(document["genesis"], HASH_BYTES),
            keys=SealedKeys.of_row(document["keys"]),
            content=exactly(document["content"], HASH_BYTES),
            numeric_class=text(document["numeric_class"]),
            width=width,
            height=height,
            samples=whole(document["samples"], 1, SAMPLES_MAX),
            seed=whole(document["seed"], 0, SEED_MAX),
            frame=whole(document["frame"], 0, 2**32 - 1),
            depth=whole(document["depth"], 1, DEPTH_MAX),
            sky=struct.unpack("<3d", document["sky"]),
            camera=struct.unpack(f"<{_CAMERA_NUMBERS}d", document["camera"]),
            nodes=tuple(NodeId(whole(node, 0, 2**32 - 1)) for node in document["nodes"]),
            partition=division.pools[0],
            others=division.pools[1:],
            head=SceneHead.of_row(document["head"]),
            layers=layers_of_row(document["layers"]),
            crop=Window.of_row(document["crop"]),
            lens=Lens.of_row(document.get("lens")),
            sampling=Sampling.of_row(document.get("sampling")),
            environment_rotation=number(document.get("environment_rotation", 0.0)),
            adaptive=Adaptive.of_row(document["adaptive"]),
            mips=flag(document.get("mips", True)),
            keeps=flag(document["keeps"]),
            moves=flag(document.get("moves", False)),
            skips=flag(document.get("skips", False)),
        )
        if job.lens is not None:
            job.lens.check()
        job.sampling.check()
        check_rotation(job.environment_rotation)
        job.window.check(width, height)
        if not 0 < len(job.nodes) <= POOL_NODES_MAX or len(set(job.nodes)) != len(job.nodes) or division.nodes != len(job.nodes):
            raise ValueError("nodes and partition do not fit together")
        if not job.keys.nodes.issuperset(job.nodes):
            raise ValueError("the keys are not sealed to all of the nodes, so the client did not choose them all")
        if job.plan.count > PASSES_MAX:
            raise ValueError("it has too many paths")
        if not all(0.0 <= channel <= SKY_MAX for channel in job.sky) or not all(map(math.isfinite, job.camera)):
            raise ValueError("the sky is no colour, or the camera no camera")
        return job
