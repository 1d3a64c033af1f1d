"""What stands in the JSON of an archive, and what its files are called (specs/24-archive.md). Pure.

Everything that is read may be anybody's: what does not fit is DamagedData that says which key.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Self

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SPACE_ID_MAX, SpaceId
from scenefold.base.limits import COPIES_MAX, PAYLOAD_BYTES_MAX, SPACE_DIMENSIONS_MAX, SPACES_PER_SCENE_MAX
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.base.names import is_space_name
from scenefold.scene.archive.settings import read_settings, settings_document
from scenefold.scene.archive.told import Told, told_json
from scenefold.scene.log import LoggedSpace
from scenefold.scene.log.growing import items_of
from scenefold.scene.log.space import Step
from scenefold.wire import RenderSettings

FORMAT, VERSION = "scenefold scene archive", 1
DESCRIPTION, END = "scene.json", "end.json"
BATCH = 256
"""Records of a part of the index, at most."""
JSON_BYTES_MAX = 64 * 1024 * 1024
"""Of one file of JSON: a scene's log has at most some hundred thousand steps."""
_OBJECT_BYTES, _DIGEST_BYTES = 16, 32


def part_name(number: int) -> str:
    """The file of a part of the index, from 1 on."""
    return f"index/{number:08d}.jsonl"


@dataclass(frozen=True, slots=True)
class ArchivedSpace:
    """A space as the scene's log described it; no shadow."""

    id: SpaceId
    name: str
    dimensions: int
    curve: Literal["hilbert", "z-order"]
    low: tuple[float, ...]
    high: tuple[float, ...]
    node_managed: bool
    render_output: bool
    copies: int
    copies_min: int
    created: int
    steps: tuple[Step, ...] = ()

    @classmethod
    def of(cls, space: LoggedSpace) -> Self:
        return cls(
            space.id,
            space.name,
            space.dimensions,
            space.curve,
            space.low,
            space.high,
            space.node_managed,
            space.render_output,
            space.copies,
            space.copies_min,
            space.created,
            tuple(items_of(space.steps)),
        )

    @property
    def shape(self) -> tuple[object, ...]:
        """What two spaces must have in common for a place to mean the same in both."""
        return self.dimensions, self.curve, self.low, self.high, self.node_managed, self.render_output

    def document(self) -> dict[str, Any]:
        steps = [{"position": step.position, "factor": step.factor, "offset": list(step.offset)} for step in self.steps]
        return {
            "space": self.id,
            "name": self.name,
            "dimensions": self.dimensions,
            "curve": self.curve,
            "low": list(self.low),
            "high": list(self.high),
            "node_managed": self.node_managed,
            "render_output": self.render_output,
            "copies": self.copies,
            "copies_min": self.copies_min,
            "created": self.created,
            "steps": steps,
        }

    @classmethod
    def read(cls, document: object) -> Self:
        told = Told(document, "a space")
        dimensions = told.whole("dimensions", 1, SPACE_DIMENSIONS_MAX)
        low, high = told.floats("low", dimensions), told.floats("high", dimensions)
        copies = told.whole("copies", 1, COPIES_MAX)
        curve, name = told.text("curve"), told.text("name")
        if not is_space_name(name) or curve not in ("hilbert", "z-order") or not all(a < b for a, b in zip(low, high, strict=True)):
            raise DamagedData(f"the space {name[:64]!r} has a name, curve or box that no space can have")
        return cls(
            SpaceId(told.whole("space", 1, SPACE_ID_MAX)),
            name,
            dimensions,
            "hilbert" if curve == "hilbert" else "z-order",
            low,
            high,
            told.flag("node_managed"),
            told.flag("render_output"),
            copies,
            told.whole("copies_min", 1, copies),
            told.whole("created", 1),
            tuple(_step(step, dimensions) for step in told.list("steps")),
        )


def _step(document: object, dimensions: int) -> Step:
    told = Told(document, "a step")
    (factor,) = told.numbers([told.get("factor")], "factor")
    if factor <= 0:
        raise DamagedData(f"a step scales by {factor}")
    return Step(told.whole("position", 1), factor, told.floats("offset", dimensions))


def position_after(position: int, before: Sequence[Step], created: int, steps: Sequence[int]) -> int:
    """The position in a new log that means for a space what this one meant in the log that it was archived from.

    `before`: the steps of the space there. `created` and `steps`: where the new log created it, and made the same ones.
    """
    made = sum(step.position <= position for step in before)
    return steps[made - 1] if made else created


@dataclass(frozen=True, slots=True)
class ArchivedScene:
    """`scene.json`."""

    name: str
    scene: str
    genesis: str
    log_position: int
    mode: str
    spaces: tuple[ArchivedSpace, ...]
    render: RenderSettings = field(default_factory=RenderSettings)

    @property
    def order(self) -> tuple[ArchivedSpace, ...]:
        """The spaces as their records follow: the first, which makes an import visible, last."""
        return tuple(sorted(self.spaces, key=lambda space: space.id == 1))

    def pack(self) -> bytes:
        document = {
            "format": FORMAT,
            "version": VERSION,
            "name": self.name,
            "scene": self.scene,
            "genesis": self.genesis,
            "log_position": self.log_position,
            "mode": self.mode,
            "render": settings_document(self.render),
            "spaces": [space.document() for space in self.spaces],
        }
        return (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        told = Told(told_json(data, DESCRIPTION), DESCRIPTION)
        if told.get("format") != FORMAT:
            raise DamagedData(f"its {DESCRIPTION} is not that of a scene")
        version = told.whole("version", 1)
        if version > VERSION:
            remedy = "upgrade this program"
            raise DamagedData(f"it has version {version} of the format, and this program knows {VERSION} at most", remedy=remedy)
        spaces = tuple(ArchivedSpace.read(space) for space in told.list("spaces"))
        distinct = len({space.id for space in spaces}) == len({space.name for space in spaces}) == len(spaces)
        if not distinct or len(spaces) > SPACES_PER_SCENE_MAX:
            raise DamagedData("two of its spaces have one number or name, or there are too many of them")
        name, scene, genesis = (told.text(key) for key in ("name", "scene", "genesis"))
        render = read_settings(told.get("render", {}))
        return cls(name, scene, genesis, told.whole("log_position", 1), told.text("mode"), spaces, render)


@dataclass(frozen=True, slots=True)
class ArchivedRecord:
    """A payload, and where it lies: `object` in a node-managed space, b"" in another one."""

    space: SpaceId
    location: Location
    object: bytes
    content_position: int
    payload: bytes = field(repr=False)
    seconds: int = 0
    """When it was written, by its number."""

    @property
    def file(self) -> str:
        return f"spaces/{self.space}/{(self.object or self.location).hex()}"

    def line(self) -> bytes:
        """Its line of the index."""
        document: dict[str, Any] = {"file": self.file, "space": self.space, "location": self.location.hex()}
        if self.object:
            document["object"] = self.object.hex()
        document |= {"bytes": len(self.payload), "sha256": hashlib.sha256(self.payload).hexdigest()}
        return (json.dumps(document | {"content_position": self.content_position}) + "\n").encode()


@dataclass(frozen=True, slots=True)
class IndexLine:
    """What a part of the index says of a record that follows."""

    space: SpaceId
    location: Location
    object: bytes
    size: int
    sha256: bytes
    content_position: int

    def record(self, file: str, payload: bytes) -> ArchivedRecord:
        """The record, of its file; DamagedData if it is another one."""
        record = ArchivedRecord(self.space, self.location, self.object, self.content_position, payload)
        if file != record.file:
            raise DamagedData(f"{file[:100]!r} stands where {record.file} was announced")
        if len(payload) != self.size or hashlib.sha256(payload).digest() != self.sha256:
            raise DamagedData(f"{file} has other bytes than were archived")
        return record


def read_part(data: bytes, name: str) -> list[IndexLine]:
    """The lines of a part of the index."""
    lines = data.splitlines()
    if not 1 <= len(lines) <= BATCH:
        raise DamagedData(f"{name} has {len(lines)} lines, not 1 to {BATCH}")
    return [_line(Told(told_json(line, name), name)) for line in lines]


def _line(told: Told) -> IndexLine:
    object_id = b"" if told.get("object", None) is None else told.hex("object", _OBJECT_BYTES)
    return IndexLine(
        SpaceId(told.whole("space", 1, SPACE_ID_MAX)),
        Location(told.hex("location", LOCATION_BYTES)),
        object_id,
        told.whole("bytes", 0, PAYLOAD_BYTES_MAX),
        told.hex("sha256", _DIGEST_BYTES),
        told.whole("content_position", 0),
    )


@dataclass(frozen=True, slots=True)
class Totals:
    """`end.json`: of all that stands in front of it."""

    records: int
    size: int
    """Of all payloads."""
    index_sha256: str

    def pack(self) -> bytes:
        return (json.dumps({"records": self.records, "bytes": self.size, "index_sha256": self.index_sha256}) + "\n").encode()

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        told = Told(told_json(data, END), END)
        return cls(told.whole("records", 0), told.whole("bytes", 0), told.text("index_sha256"))
