"""Writes specs/vectors/rays.json: rays, codes and random numbers as specs/07-rays.md says, computed without the kernels.

    .venv/bin/python tools/make_ray_vectors.py

Everything here is Python's own whole numbers, f64 arithmetic and struct, so that the vectors check the kernels
rather than repeat them.
"""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

OUTPUT = Path(__file__).parent.parent / "specs" / "vectors" / "rays.json"
WORD = 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15


def mix64(value: int) -> int:
    """The finaliser of splitmix64."""
    value = ((value ^ (value >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    value = ((value ^ (value >> 27)) * 0x94D049BB133111EB) & WORD
    return value ^ (value >> 31)


def path_key(seed: int, frame: int, pixel: int, sample: int) -> int:
    """The key of a path."""
    key = mix64((seed + GOLDEN) & WORD)
    key = mix64(key ^ (frame * GOLDEN & WORD))
    return mix64((key + ((pixel << 32) | sample) * GOLDEN) & WORD)


def uniform(key: int, bounce: int, dimension: int) -> float:
    """A number in [0, 1)."""
    return (mix64((key + (bounce * 64 + dimension + 1) * GOLDEN) & WORD) >> 11) * 2.0**-53


def sign(x: float) -> float:
    return 1.0 if x >= 0.0 else -1.0


def encode_direction(x: float, y: float, z: float) -> list[int]:
    """Octahedral, 32 bits a coordinate."""
    scale = 1.0 / (abs(x) + abs(y) + abs(z))
    u, v = x * scale, y * scale
    if z < 0.0:
        u, v = (1.0 - abs(v)) * sign(u), (1.0 - abs(u)) * sign(v)
    return [min(max(int(((c * 0.5 + 0.5) * 4294967295.0) + 0.5), 0), 2**32 - 1) for c in (u, v)]


def decode_direction(code: list[int]) -> list[float]:
    """The unit direction of a code."""
    u, v = (c * (2.0 / 4294967295.0) - 1.0 for c in code)
    z = 1.0 - abs(u) - abs(v)
    if z < 0.0:
        u, v = (1.0 - abs(v)) * sign(u), (1.0 - abs(u)) * sign(v)
    scale = 1.0 / math.sqrt(u * u + v * v + z * z)
    return [u * scale, v * scale, z * scale]


def encode_color(color: list[float], key: int, bounce: int, dimension: int) -> int:
    """Three 13-bit mantissas and a shared exponent, rounded at random."""
    color = [min(c, 8191 / 8192 * 2.0**255) for c in color]
    if not max(color) > 1e-70:
        return 0
    exponent = min(math.frexp(max(color))[1], 254)
    draws = [uniform(key, bounce, dimension + channel) for channel in range(3)]
    mantissas = [int(c * 2.0 ** (13 - exponent) + u) for c, u in zip(color, draws, strict=True)]
    if max(mantissas) > 8191:
        exponent += 1
        mantissas = [int(c * 2.0 ** (13 - exponent) + u) for c, u in zip(color, draws, strict=True)]
    r, g, b = (min(m, 8191) for m in mantissas)
    return r | g << 13 | b << 26 | (exponent + 256) << 39


def decode_color(code: int) -> list[float]:
    """The colour of a code."""
    return [(code >> 13 * channel & 8191) * 2.0 ** ((code >> 39) - 256 - 13) for channel in range(3)]


def path_ray(fields: dict[str, Any]) -> bytes:
    """36 bytes of a camera or bounce ray."""
    head = struct.pack("<3f2IHBB", *fields["origin"], *fields["direction"], fields["pdf"], 0, 0)
    tail = struct.pack("<HBBH", fields["path"], 0, fields["kind"], fields["t_done"])
    color: bytes = fields["throughput"].to_bytes(6, "little")
    return head + color + tail


def shadow_ray(fields: dict[str, Any]) -> bytes:
    """36 bytes of a shadow ray."""
    color: bytes = fields["contribution"].to_bytes(6, "little")
    tail = struct.pack("<HBBH", fields["path"], 0, fields["kind"], fields["t_done"])
    return struct.pack("<6f", *fields["origin"], *fields["end"]) + color + tail


def rays() -> list[dict[str, Any]]:
    """One ray of each kind, and one with every field at its end."""
    camera = {
        "origin": [0.5, -1.25, 3.0],
        "direction": encode_direction(0.1, -0.2, -1.0),
        "pdf": 65535,
        "throughput": encode_color([1.0, 1.0, 1.0], 0, 0, 0),
        "path": 0,
        "kind": 0,
        "t_done": 0,
    }
    bounce = {
        "origin": [0.0009765625, 0.0, -7.5],
        "direction": encode_direction(-0.3, 0.9, 0.1),
        "pdf": 23512,
        "throughput": encode_color([0.7, 0.31, 0.05], path_key(1, 0, 77, 3), 1, 8),
        "path": 40961,
        "kind": 2 << 3 | 1,
        "t_done": 12345,
    }
    extreme = {
        "origin": [3.4028234663852886e38, -1.401298464324817e-45, 0.0],
        "direction": [2**32 - 1, 0],
        "pdf": 65534,
        "throughput": 2**48 - 1,
        "path": 65535,
        "kind": 31 << 3 | 1,
        "t_done": 65535,
    }
    shadow = {
        "origin": [0.0009765625, 0.0, -7.5],
        "end": [0.0, 3.9375, 0.25],
        "contribution": encode_color([12.5, 9.0, 3.25], path_key(1, 0, 77, 3), 1, 12),
        "path": 40961,
        "kind": 1 << 3 | 2,
        "t_done": 40000,
    }
    found: list[dict[str, Any]] = [{"kind": "path", "bytes": path_ray(ray).hex(), "fields": ray} for ray in (camera, bounce, extreme)]
    return [*found, {"kind": "shadow", "bytes": shadow_ray(shadow).hex(), "fields": shadow}]


def directions() -> list[dict[str, Any]]:
    """Codes, the vectors that they come from, and the exact f64 directions that they stand for."""
    vectors = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 2.0, -3.0], [-0.1, 0.2, 5.0], [-1.0, -1.0, -1.0]]
    found: list[dict[str, Any]] = [{"vector": vector, "code": encode_direction(*vector)} for vector in vectors]
    found += [{"code": code} for code in ([0, 0], [2**32 - 1, 2**31], [1, 2**32 - 2])]
    return [{**vector, "unit": [value.hex() for value in decode_direction(vector["code"])]} for vector in found]


def colors() -> list[dict[str, Any]]:
    """Codes under a key, bounce 3, dimensions 8 to 10."""
    wanted = [
        [1.0, 1.0, 1.0],
        [0.5, 0.1, 1e-3],
        [0.0, 0.0, 0.0],
        [1e-5, 3e-9, 7.0],
        [0.99995, 0.2, 0.99999],
        [1e-68, 0.0, 0.0],
        [1e300, 1.0, 0.0],
    ]
    found = []
    for number, color in enumerate(wanted):
        key = path_key(9, 0, number, 0)
        code = encode_color(color, key, 3, 8)
        found.append({"color": color, "key": f"{key:016x}", "code": code, "decoded": [value.hex() for value in decode_color(code)]})
    return found


def densities() -> list[dict[str, Any]]:
    """Codes that stand far from a rounding edge; decoded densities that are powers of two, hence exact."""
    wanted = [(2.0**-24, 0), (1.0, 24 * 1024), (2.0**-3, 21 * 1024), (1e-30, 0), (4.0, 26 * 1024), (1e30, 65534)]
    exact = [(density, code) for density, code in wanted if code % 1024 == 0]
    return [{"density": density, "code": code, "decoded": (2.0 ** (code / 1024 - 24)).hex()} for density, code in exact]


def uniforms() -> list[dict[str, Any]]:
    """Keys and numbers."""
    wanted = [(1, 0, 0, 0, 0, 0), (1, 0, 0, 0, 0, 1), (1, 0, 77, 3, 2, 8), (2**62, 5, 2**28 - 1, 2**20 - 1, 31, 17)]
    names = ("seed", "frame", "pixel", "sample", "bounce", "dimension")
    return [
        {**dict(zip(names, one, strict=True)), "key": f"{path_key(*one[:4]):016x}", "value": uniform(path_key(*one[:4]), *one[4:]).hex()}
        for one in wanted
    ]


def thesis_record() -> dict[str, Any]:
    """Table 3.3, packed: what it has, and what next-event estimation, ledger and certificates find missing."""
    fields = [
        {"name": "origin", "bytes": 12, "value": [0.0009765625, 0.0, -7.5]},
        {"name": "direction", "bytes": 8, "value": encode_direction(-0.3, 0.9, 0.1)},
        {"name": "luminance, log Y'CbCr in 8:4:4 bits", "bytes": 4, "value": 0x0000A7B4},
        {"name": "attenuation, 16-bit logarithm", "bytes": 2, "value": 0x3A10},
        {"name": "pixel, with the age in five of its bits", "bytes": 4, "value": 2 << 27 | 77},
    ]
    values = [value for field in fields for value in (field["value"] if isinstance(field["value"], list) else [field["value"]])]
    raw = struct.pack("<3f2IIHI", *values)
    return {
        "bytes": len(raw),
        "fields": fields,
        "hex": raw.hex(),
        "missing": ["path in pass", "density of the direction", "medium", "t_done"],
    }


def main() -> None:
    """Write the file."""
    vectors = {
        "about": "Golden vectors of specs/07-rays.md, written by tools/make_ray_vectors.py.",
        "rays": rays(),
        "directions": directions(),
        "colors": colors(),
        "densities": densities(),
        "uniforms": uniforms(),
        "thesis_table_3_3": thesis_record(),
    }
    OUTPUT.write_text(json.dumps(vectors, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
