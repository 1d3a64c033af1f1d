"""A renderer in one file: NumPy, and embreex as it comes. One node; glTF's surface, without textures, alpha and glass."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition
from scenefold.render.arrays import F64, U32, JobNumbers, LightColumn, MaterialColumn
from scenefold.render.contract import Advanced, HeldScene, Tracer
from scenefold.render.flat import flat_triangles
from scenefold.render.ggx_albedo import beside_one_bounce
from scenefold.render.pass_sums import PassSums
from scenefold.render.record_columns import camera_rays, path_rays

M, L, dot = MaterialColumn, LightColumn, np.vecdot


class PlainRenderer:
    def numeric_class(self) -> str:
        return f"plain 1, numpy {np.__version__}"

    def open(self, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> PlainScene:
        rows = held.arrays.materials
        if partition.nodes != 1:
            raise LocalFault("plain renders on one node", remedy="give the job one node")
        if rows[:, [M.TRANSMISSION, M.ALPHA_MODE]].any() or (rows[:, [M.BASE_USE, M.METALLIC_ROUGHNESS_USE]] >= 0).any():
            raise LocalFault("plain knows no textures, alpha and glass", remedy="render with embree")
        return PlainScene(held, numbers)


class PlainScene:
    def __init__(self, held: HeldScene, numbers: JobNumbers) -> None:
        self.numbers, self.arrays, self.flat = numbers, held.arrays, flat_triangles(held)
        self.tree, corners = EmbreeScene(), np.arange(3 * len(self.flat.materials), dtype=np.int32)
        self.mesh = TriangleMesh(self.tree, self.flat.positions.reshape(-1, 3), corners.reshape(-1, 3))
        self.diagonal = float(np.linalg.norm(numbers.box_high - numbers.box_low))

    def tracers(self, count: int) -> list[Tracer]:
        return [PlainTracer(self) for _ in range(count)]

    def close(self) -> None:
        self.tree = self.mesh = None


def unit(vectors: F64) -> F64:
    return vectors / np.maximum(np.sqrt((vectors**2).sum(axis=1, keepdims=True)), 1e-30)


class Surface:
    """glTF 2.0, appendix B, at n points: base colour f64[n, 3], metallic and roughness f64[n], f0; z is the normal."""

    def __init__(self, rows: F64) -> None:
        self.base, self.metallic = rows[:, M.BASE : M.BASE + 3], rows[:, M.METALLIC, None]
        self.rough, self.alpha = rows[:, M.ROUGHNESS].astype(np.float64), np.maximum(rows[:, M.ROUGHNESS] ** 2, 1e-3)
        self.f0 = (((rows[:, M.IOR] - 1) / (rows[:, M.IOR] + 1)) ** 2)[:, None]
        self.coat = np.where(rows[:, M.METALLIC] == 1, 0.9, 0.5)  # how often `sample` takes the specular part

    def evaluate(self, wo: F64, wi: F64) -> tuple[F64, F64]:
        """(BSDF times cosine f64[n, 3], density of `sample` f64[n])"""
        a2, f0 = self.alpha**2, self.f0 + (self.base - self.f0) * self.metallic
        h, o, i = unit(wo + wi), np.maximum(wo[:, 2], 1e-9), np.maximum(wi[:, 2], 0.0)
        d = a2 / (np.pi * (h[:, 2] ** 2 * (a2 - 1) + 1) ** 2)
        root_o, root_i = np.sqrt(a2 + (1 - a2) * o * o), np.sqrt(a2 + (1 - a2) * i * i)
        shine = (d * 0.5 / (i * root_o + o * root_i))[:, None]
        m = (1 - np.clip(dot(wo, h), 0, 1))[:, None] ** 5
        value = (f0 + (1 - f0) * m) * shine + beside_one_bounce(self.base, self.metallic, self.rough, self.f0, o, i)
        density = self.coat * d / (2 * (o + root_o)) + (1 - self.coat) * i / np.pi
        return value * i[:, None], density

    def sample(self, wo: F64, dice: np.random.Generator) -> F64:
        """Directions: off visible normals (Heitz 2018), or by the cosine."""
        u, v, lobe = dice.random((3, len(wo)))
        x, y = np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v)
        stretched = unit(wo * np.stack([self.alpha, self.alpha, np.ones(len(wo))], axis=1))
        across = unit(np.stack([-stretched[:, 1], stretched[:, 0] + 1e-12, 0 * u], axis=1))
        s = 0.5 * (1 + stretched[:, 2])
        bent = (1 - s) * np.sqrt(1 - x * x) + s * y
        h = x[:, None] * across + bent[:, None] * np.cross(stretched, across)
        h += np.sqrt(np.maximum(1 - x * x - bent * bent, 0))[:, None] * stretched
        h = unit(np.stack([self.alpha * h[:, 0], self.alpha * h[:, 1], np.maximum(h[:, 2], 1e-9)], axis=1))
        return np.where((lobe < self.coat)[:, None], 2 * dot(wo, h)[:, None] * h - wo, np.stack([x, y, np.sqrt(1 - u)], axis=1))


@dataclass
class PlainTracer:
    scene: PlainScene

    def generate(self, first_path: int, count: int) -> dict[int, U32]:
        return {0: camera_rays(self.scene.numbers, first_path, count)}

    def advance(self, rays: U32, first_path: int, sums: PassSums) -> Advanced:
        numbers, some = self.scene.numbers, path_rays(rays, len(sums.radiance))
        dice = np.random.default_rng([zlib.crc32(rays.tobytes()), numbers.seed])
        light, casts = np.zeros((len(some.rows), 3)), 0
        lane, origin, way, weight = np.arange(len(light)), some.origins, some.directions, some.throughputs
        for segment in range(numbers.depth):
            found = self.scene.tree.run(origin.astype(np.float32), way.astype(np.float32), output=1)
            hit, casts = found["primID"] >= 0, casts + len(lane)
            light[lane[~hit]] += weight[~hit] * numbers.sky
            lane, origin, way, weight = lane[hit], origin[hit], way[hit], weight[hit]
            triangle, u, v, t = (found[name][hit] for name in ("primID", "u", "v", "tfar"))
            corners = np.stack([1 - u - v, u, v], axis=1)[:, :, None]
            edges = self.scene.flat.positions[triangle].astype(np.float64)
            n = unit(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]))
            front, smooth = dot(n, way) < 0, (self.scene.flat.normals[triangle] * corners).sum(axis=1)
            n = np.where(front[:, None], n, -n)
            smooth *= np.where(dot(smooth, n) < 0, -1.0, 1.0)[:, None]
            z = np.where((dot(smooth, way) < -1e-4)[:, None], unit(smooth), n)
            point = origin + way * t[:, None] + n * self.scene.diagonal * 1e-5
            rows = self.scene.arrays.materials[self.scene.flat.materials[triangle]]
            light[lane] += weight * rows[:, M.EMISSION : M.EMISSION + 3] * (front | (rows[:, M.DOUBLE_SIDED] != 0))[:, None]
            if segment == 0:
                depth = np.minimum(t / self.scene.diagonal, 100.0)[:, None]  # from where the ray enters the box: near enough here
                features = np.concatenate([rows[:, M.BASE : M.BASE + 3], z, depth, np.full_like(depth, 2.0**-24)], axis=1)
                sums.aovs[some.paths[lane]] = features * 2.0**24
            if segment + 1 == numbers.depth:
                break
            x = unit(np.cross(z, np.where(np.abs(z[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])))
            frame = np.stack([x, np.cross(z, x), z], axis=1)
            wo, surface = (frame @ -way[:, :, None])[:, :, 0], Surface(rows)
            for lamp in self.scene.arrays.punctual_lights:
                light[lane] += weight * self.from_lamp(lamp, point, n, frame, wo, surface)
            wi = surface.sample(wo, dice)
            value, density = surface.evaluate(wo, wi)
            way, weight = (wi[:, None, :] @ frame)[:, 0], weight * value / np.maximum(density, 1e-30)[:, None]
            lives = np.minimum(weight.max(axis=1), 1.0) if segment > 2 else np.ones(len(lane))
            on = (wi[:, 2] > 0) & (dot(way, n) > 0) & (dice.random(len(lane)) < lives)
            lane, origin, way, weight = lane[on], point[on], way[on], weight[on] / lives[on, None]
        np.add.at(sums.radiance, some.paths, (np.clip(light, 0, 2.0**24) * 2.0**32 + 0.5).astype(np.int64))
        return Advanced({}, 0, len(rays), casts, 0)

    def from_lamp(self, lamp: F64, point: F64, n: F64, frame: F64, wo: F64, surface: Surface) -> F64:
        """What a punctual light sends over each point, f64[n, 3]."""
        axis, place = lamp[L.DIRECTION : L.DIRECTION + 3], lamp[L.POSITION : L.POSITION + 3]
        to = place - point if lamp[L.KIND] != 2 else np.broadcast_to(-axis * self.scene.diagonal, point.shape)
        wi = (frame @ unit(to)[:, :, None])[:, :, 0]
        fade = np.where(lamp[L.KIND] == 2, 1.0, 1 / dot(to, to))
        if lamp[L.KIND] == 1:
            ratio = (-unit(to) @ axis - lamp[L.COS_OUTER]) / max(lamp[L.COS_INNER] - lamp[L.COS_OUTER], 1e-3)
            fade = fade * np.clip(ratio, 0, 1) ** 2
        blocked = self.scene.tree.run(point.astype(np.float32), to.astype(np.float32), np.ones(len(to), np.float32), query="OCCLUDED") >= 0
        fade = np.where(blocked | (wi[:, 2] <= 0) | (dot(to, n) <= 0), 0.0, fade)
        return surface.evaluate(wo, wi)[0] * fade[:, None] * lamp[L.COLOR : L.COLOR + 3]
