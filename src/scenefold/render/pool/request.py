"""What a client asks of the node that organises a job, and which node that is (specs/19-jobs.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from scenefold.base.errors import LocalFault, PeerFault
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.plain_values import exactly, flag, number, text, whole
from scenefold.render.job import HASH_BYTES, RenderOptions, layers_of_row
from scenefold.render.lens import Lens
from scenefold.render.levels import Adaptive
from scenefold.render.passes import place_of
from scenefold.render.pool.own_passes import owner_index
from scenefold.render.pool.unattended import Unattended
from scenefold.render.sampling import Sampling
from scenefold.render.sealed_keys import SealedKeys
from scenefold.render.window import Window
from scenefold.scene.head import NO_HEAD, SceneHead
from scenefold.wire import Value, pack_value

WORD = -(2**63), 2**64 - 1
"""Whole numbers of the wire. What is out of an option's own range is told with the option's name (`RenderOptions.check`)."""
_ANEW = "remove the file of the kept render to begin anew"


@dataclass(frozen=True, slots=True)
class Keep:
    """A render of which films are kept, so that another one may go on from them."""

    passes: int = 0
    """It goes on from a film of all passes below this one; 0: it begins anew, and nothing is known of the other two."""
    content: bytes = bytes(HASH_BYTES)
    """Digest of the scene that the film is of."""
    numeric_class: str = ""

    def row(self) -> list[int | bytes | str]:
        """Plain values."""
        return [self.passes, self.content, self.numeric_class]

    def check(self, digest: bytes, numeric_class: str) -> None:
        """LocalFault if the film is of another scene than this one, or came about with other arithmetic."""
        if self.content != digest:
            raise LocalFault("the scene is not the one that the kept render is of, or was changed", where="resume", remedy=_ANEW)
        if self.numeric_class != numeric_class:
            what = f"the kept render is of the numeric class {self.numeric_class:.80}, which is not that of the nodes"
            raise LocalFault(what, where="resume", remedy=f"render with the same versions and processors, or {_ANEW}")

    @classmethod
    def of_row(cls, row: Any) -> Self | None:
        """What `row` gave, or None for None; ValueError or TypeError for anything else."""
        if row is None:
            return None
        passes, content, numeric_class = row
        return cls(whole(passes, 0, 2**32 - 1), exactly(content, HASH_BYTES), text(numeric_class))


@dataclass(frozen=True, slots=True)
class RenderRequest:
    """`keys`: sealed to those that may render, and they do."""

    job: int
    scene: SceneId
    genesis: bytes
    keys: SealedKeys
    options: RenderOptions
    head: SceneHead = NO_HEAD
    keep: Keep | None = None
    """None: no film of it is kept before it is done."""
    unattended: Unattended | None = None
    """None: its client waits for the image, and it is given up without it."""

    def to_bytes(self) -> bytes:
        """The packed document."""
        return pack_value(
            {
                "request": True,
                "scene": int(self.scene),
                "genesis": self.genesis,
                "keys": self.keys.row(),
                "head": self.head.row(),
                **options_document(self.options),
                "keep": None if self.keep is None else self.keep.row(),
                "unattended": None if self.unattended is None else self.unattended.row(),
            }
        )

    @classmethod
    def from_map(cls, job: int, document: dict[str, Any]) -> RenderRequest:
        """The request of a document; PeerFault if it is none."""
        try:
            options = options_of(document)
            request = cls(
                job,
                SceneId(whole(document["scene"], 0, 2**32 - 1)),
                exactly(document["genesis"], HASH_BYTES),
                SealedKeys.of_row(document["keys"]),
                options,
                SceneHead.of_row(document["head"]),
                Keep.of_row(document["keep"]),
                Unattended.of_row(document.get("unattended")),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise PeerFault("a request to render is ill-formed", where=f"{type(error).__name__}: {error}") from error
        options.check()
        if request.keep is not None and request.keep.passes >= options.plan.count:
            raise PeerFault("a render goes on from more passes than it has", where=f"{request.keep.passes} of {options.plan.count}")
        return request


def options_document(options: RenderOptions) -> dict[str, Value]:
    """Options as plain values."""
    return {
        "width": options.width,
        "height": options.height,
        "samples": options.samples,
        "seed": options.seed,
        "depth": options.depth,
        "sky": [float(channel) for channel in options.sky],
        "camera": options.camera,
        "algorithm": options.algorithm,
        "moving": options.moving,
        "layers": list(options.layers),
        "crop": None if options.crop is None else options.crop.row(),
        "lens": None if options.lens is None else options.lens.row(),
        "sampling": options.sampling.row(),
        "environment_rotation": float(options.environment_rotation),
        "adaptive": None if options.adaptive is None else options.adaptive.row(),
        "mips": options.mips,
        "pools": options.pools,
        "skips": options.skips,
    }


def options_of(document: dict[str, Any]) -> RenderOptions:
    """What `options_document` gave, unchecked; KeyError, TypeError or ValueError for anything else."""
    red, green, blue = (number(channel) for channel in document["sky"])
    camera = document["camera"]
    return RenderOptions(
        width=whole(document["width"], *WORD),
        height=whole(document["height"], *WORD),
        samples=whole(document["samples"], *WORD),
        seed=whole(document["seed"], *WORD),
        depth=whole(document["depth"], *WORD),
        sky=(red, green, blue),
        camera=None if camera is None else text(camera),
        algorithm=text(document["algorithm"]),
        moving=flag(document.get("moving", False)),
        layers=layers_of_row(document["layers"]),
        crop=Window.of_row(document["crop"]),
        lens=Lens.of_row(document.get("lens")),
        sampling=Sampling.of_row(document.get("sampling")),
        environment_rotation=number(document.get("environment_rotation", 0.0)),
        adaptive=Adaptive.of_row(document["adaptive"]),
        mips=flag(document.get("mips", True)),
        pools=whole(document.get("pools", 1), *WORD),
        skips=flag(document.get("skips", False)),
    )


def organiser_of(job: int, nodes: Sequence[NodeId]) -> NodeId:
    """Which of the nodes that may render organises a job: the owner of the job's place, were the line theirs in even arcs."""
    return nodes[owner_index(place_of(b"job", job), len(nodes))]
