"""Writes specs/vectors/rays.json: rays, codes and random numbers as specs/07-rays.md says, computed without the kernels.

    .venv/bin/python tools/make_ray_vectors.py

Everything here is Python's own whole numbers, numpy's f32 one operation at a time, and struct, so that the vectors
check the kernels rather than repeat them.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np

OUTPUT = Path(__file__).parent.parent / "specs" / "vectors" / "rays.json"
WORD = 2**64 - 1
HALF = 2**32 - 1
GOLDEN = 0x9E3779B97F4A7C15
F = np.float32


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


def hash32(value: int) -> int:
    """32 bits to 32 bits."""
    value = ((value ^ (value >> 16)) * 0x7FEB352D) & HALF
    value = ((value ^ (value >> 15)) * 0x846CA68B) & HALF
    return value ^ (value >> 16)


def turned(value: int) -> int:
    """The bits, the last one first."""
    return int(f"{value:032b}"[::-1], 2)


def scrambled(value: int, seed: int) -> int:
    """Laine's and Karras's hash."""
    value ^= value * 0x3D20ADEA & HALF
    value = (value + seed) * (seed >> 16 | 1) & HALF
    value ^= value * 0x05526C56 & HALF
    return value ^ (value * 0x53A22864 & HALF)


def dice_seed(seed: int, frame: int) -> tuple[int, int]:
    """The lower and the upper word that a job's numbers follow from."""
    digest = hashlib.sha256(b"scenefold/dice" + struct.pack(">QQ", seed, frame)).digest()
    return int.from_bytes(digest[4:8], "big"), int.from_bytes(digest[:4], "big")


def pair_seed(seed: int, frame: int, pixel: int, bounce: int, pair: int) -> int:
    """What a pair of a pixel's bounce follows from."""
    low, high = dice_seed(seed, frame)
    of_pixel = hash32(hash32((pixel + low) & HALF) ^ high)
    return hash32(of_pixel ^ ((bounce * 8 + pair + 1) * 0x9E3779B9 & HALF))


def independent(seed: int, sample: int) -> list[float]:
    """A pair of the sampler `independent`."""
    first = hash32(seed ^ ((sample * 0x9E3779B9 + 0x85EBCA6B) & HALF))
    return [(word >> 8) * 2.0**-24 for word in (first, hash32(first ^ 0x85EBCA6B))]


def sobol(seed: int, sample: int) -> list[float]:
    """A pair of the sampler `sobol`."""
    index = turned(scrambled(turned(sample), seed))
    second = sum(1 << bit for bit in range(32) if sum(index >> j & 1 for j in range(32) if bit & j == bit) % 2)
    words = turned(scrambled(index, hash32(seed ^ 0x9E3779B9))), turned(scrambled(second, hash32(seed ^ 0x85EBCA6B)))
    return [(word >> 8) * 2.0**-24 for word in words]


def noise(seed: int, frame: int, pixel: int, sample: int, bounce: int, pair: int) -> list[float]:
    """Three numbers that a colour is rounded by."""
    word = hash32(pair_seed(seed, frame, pixel, bounce, pair) ^ ((sample * 0x9E3779B9 + 0x85EBCA6B) & HALF))
    return [((word >> shift & 1023) + 0.5) / 1024 for shift in (0, 10, 20)]


def sign(x: np.float32) -> np.float32:
    return F(1.0 if x >= 0.0 else -1.0)


def unfolded(u: np.float32, v: np.float32, z: np.float32) -> tuple[np.float32, np.float32]:
    """Octahedral coordinates of the other side, where z is below 0."""
    return ((F(1) - abs(v)) * sign(u), (F(1) - abs(u)) * sign(v)) if z < 0 else (u, v)


def encode_direction(x: float, y: float, z: float) -> list[int]:
    """Octahedral, 32 bits with a sign a coordinate, as they stand in the record."""
    a, b, c = F(x), F(y), F(z)
    scale = F(1) / (abs(a) + abs(b) + abs(c))
    coordinates = unfolded(a * scale, b * scale, c)
    return [2**31 - 1 if one >= 1 else int(max(F(-1), one) * F(2.0**31)) & HALF for one in coordinates]


def decode_direction(code: list[int]) -> list[float]:
    """The unit direction of a code."""
    u, v = (F((c ^ 2**31) - 2**31) * F(2.0**-31) for c in code)
    z = F(1) - abs(u) - abs(v)
    u, v = unfolded(u, v, z)
    scale = F(1) / np.sqrt(u * u + v * v + z * z)
    return [float(u * scale), float(v * scale), float(z * scale)]


def encode_color(color: list[float], draws: list[float]) -> int:
    """Three 13-bit mantissas and a shared exponent, rounded at random."""
    most = F(8191 / 8192 * 2.0**126)
    bounded = [min(F(c), most) for c in color]
    if not max(bounded) > F(2.0**-100):
        return 0
    exponent = math.frexp(float(max(bounded)))[1]
    scaled = [c * F(2.0 ** (13 - exponent)) + F(u) for c, u in zip(bounded, draws, strict=True)]
    if int(max(scaled)) > 8191:
        exponent += 1
        scaled = [c * F(2.0 ** (13 - exponent)) + F(u) for c, u in zip(bounded, draws, strict=True)]
    r, g, b = (min(int(m), 8191) for m in scaled)
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
        "throughput": encode_color([1.0, 1.0, 1.0], [0.5, 0.5, 0.5]),
        "path": 0,
        "kind": 0,
        "t_done": 0,
    }
    bounce = {
        "origin": [0.0009765625, 0.0, -7.5],
        "direction": encode_direction(-0.3, 0.9, 0.1),
        "pdf": 23512,
        "throughput": encode_color([0.7, 0.31, 0.05], noise(1, 0, 77, 3, 1, 6)),
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
        "contribution": encode_color([12.5, 9.0, 3.25], noise(1, 0, 77, 3, 1, 7)),
        "path": 40961,
        "kind": 1 << 3 | 2,
        "t_done": 40000,
    }
    found: list[dict[str, Any]] = [{"kind": "path", "bytes": path_ray(ray).hex(), "fields": ray} for ray in (camera, bounce, extreme)]
    return [*found, {"kind": "shadow", "bytes": shadow_ray(shadow).hex(), "fields": shadow}]


def directions() -> list[dict[str, Any]]:
    """Codes, the vectors that they come from, and the exact f32 directions that they stand for."""
    vectors = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 2.0, -3.0], [-0.1, 0.2, 5.0], [-1.0, -1.0, -1.0]]
    found: list[dict[str, Any]] = [{"vector": vector, "code": encode_direction(*vector)} for vector in vectors]
    found += [{"code": code} for code in ([0, 0], [2**32 - 1, 2**31], [1, 2**32 - 2], [2**31 - 1, 2**31 - 1])]
    return [{**vector, "unit": [value.hex() for value in decode_direction(vector["code"])]} for vector in found]


def colors() -> list[dict[str, Any]]:
    """Codes, and the word whose bits they are rounded by."""
    wanted = [
        [1.0, 1.0, 1.0],
        [0.5, 0.1, 1e-3],
        [0.0, 0.0, 0.0],
        [1e-5, 3e-9, 7.0],
        [0.99995, 0.2, 0.99999],
        [1e-31, 0.0, 0.0],
        [1e38, 1.0, 0.0],
    ]
    found = []
    for number, color in enumerate(wanted):
        word = hash32(number + 1)
        code = encode_color(color, [((word >> shift & 1023) + 0.5) / 1024 for shift in (0, 10, 20)])
        found.append({"color": color, "dice": word, "code": code, "decoded": [value.hex() for value in decode_color(code)]})
    return found


def densities() -> list[dict[str, Any]]:
    """Codes that stand far from a rounding edge; decoded densities that are powers of two, hence exact."""
    wanted = [(2.0**-24, 0), (1.0, 24 * 1024), (2.0**-3, 21 * 1024), (1e-30, 0), (4.0, 26 * 1024), (1e30, 65534)]
    exact = [(density, code) for density, code in wanted if code % 1024 == 0]
    return [{"density": density, "code": code, "decoded": (2.0 ** (code / 1024 - 24)).hex()} for density, code in exact]


def draws() -> list[dict[str, Any]]:
    """Pairs of both samplers."""
    wanted = [(1, 0, 0, 0, 0, 0), (1, 0, 0, 1, 0, 0), (1, 0, 77, 3, 2, 1), (2**62, 5, 2**28 - 1, 2**20 - 1, 31, 5)]
    names = ("seed", "frame", "pixel", "sample", "bounce", "pair")
    found = []
    for one in wanted:
        seed, frame, pixel, sample, bounce, pair = one
        word = pair_seed(seed, frame, pixel, bounce, pair)
        low, high = dice_seed(seed, frame)
        found.append(
            {
                **dict(zip(names, one, strict=True)),
                "dice_low": low,
                "dice_high": high,
                "sobol": [value.hex() for value in sobol(word, sample)],
                "independent": [value.hex() for value in independent(word, sample)],
                "key": f"{path_key(seed, frame, pixel, sample):016x}",
            }
        )
    return found


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
        "draws": draws(),
        "thesis_table_3_3": thesis_record(),
    }
    OUTPUT.write_text(json.dumps(vectors, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
