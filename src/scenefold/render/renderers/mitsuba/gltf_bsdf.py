"""glTF's metallic-roughness surface as a Mitsuba BSDF, written from the formulas of glTF 2.0, appendix B.

    dielectric = specular F_d + further(F_d) + diffuse      F_d = f0 + (1 - f0)(1 - V.H)^5,  f0 = ((ior - 1) / (ior + 1))^2,
                 with KHR_materials_specular f0 = min(f0 tint, 1) weight, weight in place of 1, and of 1 - F_d the least channel
    metal      = specular F_m + further(F_m)      F_m = c + (1 - c)(1 - V.H)^5
    material   = mix(dielectric, metal, metallic)
    specular = V D: GGX, height-correlated Smith, alpha = roughness^2

but that nothing is lost (specs/09-renderer-contract.md, with the tables of ggx_albedo.py): further(F) is what comes out after more than one
bounce, and the diffuse body c (1 - S(V))(1 - S(L)) / (pi (1 - Smean)) has what the layer's albedo S leaves, both ways.

Alpha and smooth thin transmission (KHR_materials_transmission, infinitely thin) are the null component: what
passes straight on is 1 - a + a q c, q = transmission (1 - metallic)(1 - S(cosine at the geometric normal)).
Of rough walls it is transmission (1 - metallic) c times the specular lobe, mirrored through the surface, with 1 - F in place of F, and what
is missing of that to 1 - S. A solid body (KHR_materials_volume) is Walter's rough dielectric, whose radiance goes by the square of the
index, tinted by c, mixed in by transmission (1 - metallic); what is scattered at its inner side was absorbed on the way from the ray's origin.

Over it lies KHR_materials_clearcoat: mix(material, GGX with all bounces, c F), F Schlick's term of 0.04 at the angle of the viewer.

Normals: the shading normal is turned to the side of the geometric one that is seen, and where it looks away from the viewer the
geometric one takes its place; a side is that of the geometric normal, and of the shading normal as well.
Mitsuba's microfacet distribution and warps draw the directions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from scenefold.render import glass_albedo
from scenefold.render.ggx_albedo import AVERAGES, NODES, TABLE
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.renderers.mitsuba.looks import Looks

ALPHA_LEAST = 1e-3
"""Smoother surfaces are rendered as this smooth (specs/09-renderer-contract.md)."""
_IOR_LEAST = 1.0 + 2.0**-10
_HIDDEN = 1e-4
_COAT_GLOSSY = 0.75
"""How often a coat's directions are drawn from its microfacets, and not by the cosine."""


def gltf_bsdf(mitsuba: Mitsuba, looks: Looks) -> Any:
    """A BSDF instance of this material."""
    return bsdf_class(mitsuba)(looks)


_classes: dict[str, Any] = {}
_albedo_tables: dict[str, Any] = {}


def _tables(mitsuba: Mitsuba) -> Any:
    """1 - E and B by roughness and cosine, Float[NODES * NODES], their means by roughness, Float[NODES], and glass's E from both sides."""
    if mitsuba.variant not in _albedo_tables:
        glass = glass_albedo.TABLE
        parts = (TABLE & np.uint32(0xFFFF)) / 65535.0, (TABLE >> np.uint32(16)) / 65535.0, *AVERAGES.T
        parts = (*parts, (glass & np.uint32(0xFFFF)) / 65535.0, (glass >> np.uint32(16)) / 65535.0)
        given = mitsuba.mi.Float if mitsuba.is_wavefront else np.asarray
        _albedo_tables[mitsuba.variant] = [given(np.ascontiguousarray(part, np.float32)) for part in parts]
    return _albedo_tables[mitsuba.variant]


def bsdf_class(mitsuba: Mitsuba) -> Any:
    """The class, made once a variant: what it derives from exists only then."""
    if mitsuba.variant not in _classes:
        _classes[mitsuba.variant] = _make_class(mitsuba)
    return _classes[mitsuba.variant]


def _make_class(mitsuba: Mitsuba) -> Any:  # noqa: C901  (a class within, method by method)
    mi, dr = mitsuba.mi, mitsuba.dr

    class GltfBsdf(mi.BSDF):  # type: ignore[name-defined, misc]
        """Components: 0 straight on (null), 1 reflection, 2 scattered through."""

        def __init__(self, looks: Looks) -> None:
            mi.BSDF.__init__(self, mi.Properties("scenefold_gltf"))
            self.looks = looks
            both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            components = [mi.BSDFFlags.Null | both, mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.DiffuseReflection | both]
            flags = components[0] | components[1] if looks.may_pass else components[1]
            self.scatters = looks.solid or looks.rough_wall
            if self.scatters:
                components.append(mi.BSDFFlags.GlossyTransmission | mi.BSDFFlags.DiffuseTransmission | both)
                flags |= components[2]
            self.m_components, self.m_flags = components, flags

        def _frame(self, si: Any, of_coat: bool = False) -> tuple[Any, Any, Any]:
            """(frame around the turned shading normal, tilted by its map or by that of the coat, turned geometric normal, viewer's direction in the world)."""
            towards = si.to_world(si.wi)
            n = dr.select(dr.dot(si.n, towards) < 0.0, -si.n, si.n)
            s = dr.select(dr.dot(si.sh_frame.n, n) < 0.0, -si.sh_frame.n, si.sh_frame.n)
            s = dr.select(dr.dot(s, towards) <= _HIDDEN, n, s)
            tilt = self.looks.coat_tilt if of_coat else self.looks.tilt
            if tilt is not None:
                side = dr.select(dr.dot(si.n, towards) < 0.0, -1.0, 1.0)
                tilted = tilt.normal(si, s * side) * side
                s = dr.select((dr.dot(tilted, towards) > _HIDDEN) & (dr.dot(tilted, n) > _HIDDEN), tilted, s)
            return mi.Frame3f(s), n, towards

        def _fresnel(self, f0: Any, cosine: Any, f90: Any = 1.0) -> Any:
            m = dr.clip(1.0 - cosine, 0.0, 1.0)
            return f0 + (f90 - f0) * (m * m) * (m * m) * m

        def _dielectric(self, si: Any, cosine: Any, active: Any) -> Any:
            """F_d, Color3f."""
            weight, tint = self.looks.specular(si, active)
            f0 = dr.square((self.looks.ior - 1.0) / (self.looks.ior + 1.0))
            return self._fresnel(dr.minimum(f0 * tint, 1.0) * weight, cosine, weight)

        def _read(self, table: Any, places: Any) -> Any:
            return dr.gather(mi.Float, table, mi.UInt32(places)) if mitsuba.is_wavefront else float(table[int(places)])

        def _albedo(self, roughness: Any, cosine: Any) -> tuple[Any, Any, Any, Any]:
            """(1 - E, B) towards a cosine, and their means over all."""
            x = dr.clip(dr.maximum(roughness, dr.sqrt(ALPHA_LEAST)), 0.0, 1.0) * (NODES - 1)
            y = dr.sqrt(dr.clip(cosine, 0.0, 1.0)) * (NODES - 1)
            row, column = dr.minimum(dr.floor(x), NODES - 2.0), dr.minimum(dr.floor(y), NODES - 2.0)
            tables, found = _tables(mitsuba), []
            for table in tables[:2]:
                lower, upper = (
                    dr.lerp(*(self._read(table, (row + up) * NODES + column + right) for right in (0, 1)), y - column) for up in (0, 1)
                )
                found.append(dr.lerp(lower, upper, x - row))
            found += [dr.lerp(self._read(table, row), self._read(table, row + 1.0), x - row) for table in tables[2:4]]
            return found[0], found[1], found[2], found[3]

        def _further(self, f0: Any, f90: Any, missing: Any) -> Any:
            """What share of the light that one bounce loses comes out after more of them."""
            mean = f0 + (f90 - f0) / 21.0
            return dr.square(mean) * (1.0 - missing) / (1.0 - mean * missing)

        def _left(self, f0: Any, f90: Any, missing: Any, grazing: Any, missing_mean: Any) -> Any:
            """What the dielectric layer does not give back, Float: by its strongest channel."""
            f0 = dr.max(f0)
            return dr.maximum(1.0 - f0 * (1.0 - missing - grazing) - f90 * grazing - self._further(f0, f90, missing_mean) * missing, 0.0)

        def _passing(self, si: Any, active: Any) -> Any:
            """What passes straight on, Color3f."""
            base, opacity = self.looks.base(si, active), self.looks.opacity(si, active)
            roughness, metallic = self.looks.roughness_metallic(si, active)
            _, n, towards = self._frame(si)
            missing, grazing, missing_mean, _ = self._albedo(roughness, dr.dot(n, towards))
            left = self._left(self._dielectric(si, 1.0, active), self.looks.specular(si, active)[0], missing, grazing, missing_mean)
            if self.scatters:
                return mi.Color3f(1.0 - opacity)
            q = self.looks.transmission(si, active) * (1.0 - metallic) * left
            if self.looks.coated:
                q *= 1.0 - self._coat(si, dr.dot(n, towards), active)[0]
            return 1.0 - opacity + opacity * q * base

        def _mirror(self, v: Any, l: Any, alpha: Any) -> tuple[Any, Any]:
            """Value without cosine, and density, of GGX that reflects everything."""
            h, a2 = dr.normalize(v + l), alpha * alpha
            # The appendix's D. Mitsuba writes it so that single precision bears very smooth surfaces.
            distribution = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, alpha, alpha, True)
            # Smith's height-correlated visibility, V of the appendix, is G2 / (4 N.L N.V).
            visibility = 0.5 / (l.z * dr.sqrt(dr.square(v.z) * (1.0 - a2) + a2) + v.z * dr.sqrt(dr.square(l.z) * (1.0 - a2) + a2))
            return visibility * distribution.eval(h), distribution.pdf(v, h) / (4.0 * dr.dot(v, h))

        def _glass_alpha(self, alpha: Any) -> Any:
            """Facets that bend no light hide none."""
            return dr.select(self.looks.ior > _IOR_LEAST, alpha, ALPHA_LEAST)

        def _share_through(self, si: Any, active: Any) -> Any:
            """Transmission of what is no metal, Float."""
            return self.looks.transmission(si, active) * (1.0 - self.looks.roughness_metallic(si, active)[1])

        def _chance_through(self, si: Any, active: Any) -> Any:
            """With which probability, where neither passed nor off a coat, a direction is drawn from the lobe of glass, or beyond a wall."""
            return dr.clip(self._share_through(si, active), 0.0, 1.0 if self.looks.solid else 0.9)

        def _index(self, si: Any, towards: Any) -> Any:
            """Of what lies beyond the surface by what is on the viewer's side."""
            ior = dr.maximum(self.looks.ior, _IOR_LEAST)
            return dr.select(dr.dot(si.n, towards) > 0.0, ior, 1.0 / ior)

        def _glass(self, v: Any, l: Any, alpha: Any, eta: Any) -> tuple[Any, Any]:
            """Value without tint and cosine, and density, of a rough dielectric, on both sides."""
            reflects = l.z > 0.0
            h = dr.normalize(v + l * dr.select(reflects, 1.0, eta))
            h = dr.select(h.z < 0.0, -h, h)
            a2, vh, lh = alpha * alpha, dr.dot(v, h), dr.dot(l, h)
            fresnel, _, _, _ = mi.fresnel(vh, eta)
            distribution = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, alpha, alpha, True)
            # 1 + Lambda(v) + Lambda(l), height-correlated as in the appendix.
            tails = [dr.sqrt(1.0 + a2 * (dr.square(w.x) + dr.square(w.y)) / dr.square(w.z)) for w in (v, l)]
            shadowing = 2.0 / (tails[0] + tails[1])
            bent = dr.square(eta) * dr.abs(lh) / dr.square(vh + eta * lh)
            value = dr.select(
                reflects, fresnel / 4.0, (1.0 - fresnel) * vh * bent
            ) * distribution.eval(h) * shadowing / (v.z * dr.abs(l.z))  # fmt: skip
            density = distribution.pdf(v, h) * dr.select(reflects, fresnel / (4.0 * vh), (1.0 - fresnel) * bent)
            good = (vh > 0.0) & dr.select(reflects, lh > 0.0, lh < 0.0)
            return dr.select(good, value / self._kept_by_glass(alpha, v.z, eta), 0.0), dr.select(good, density, 0.0)

        def _kept_by_glass(self, alpha: Any, cosine: Any, eta: Any) -> Any:
            """What one bounce mirrors and bends of light from a cosine: as much is to come from it and all others."""
            ior = dr.maximum(eta, 1.0 / eta)
            axes = (
                (dr.sqrt(alpha), glass_albedo.ROUGHNESSES),
                (dr.sqrt(dr.maximum(cosine, 0.0)), glass_albedo.COSINES),
                (dr.sqrt((ior - 1.0) / (ior + 1.0)), glass_albedo.INDICES),
            )
            lows, parts = [], []
            for at, count in axes:
                at = dr.clip(at, 0.0, 1.0) * (count - 1)
                lows.append(dr.minimum(dr.floor(at), count - 2.0))
                parts.append(at - lows[-1])
            kept: Any = 0.0
            for corner in np.ndindex(2, 2, 2):
                weight, place = 1.0, 0.0
                for low, part, upper, (_, count) in zip(lows, parts, corner, axes, strict=True):
                    weight, place = weight * (part if upper else 1.0 - part), place * count + low + upper
                without, within = (self._read(table, place) for table in _tables(mitsuba)[4:])
                kept = kept + weight * dr.select(eta < 1.0, within, without)
            return dr.maximum(kept, 1.0 / 64.0)

        def _beyond(self, v: Any, l: Any, alpha: Any, roughness: Any, f0: Any, f90: Any) -> tuple[Any, Any]:
            """Value without tint and cosine, and density, of what comes through a rough wall, l.z < 0."""
            mirrored = mi.Vector3f(l.x, l.y, -l.z)
            specular, density = self._mirror(v, mirrored, alpha)
            missing_v, _, missing, _ = self._albedo(roughness, v.z)
            missing_l, _, _, _ = self._albedo(roughness, mirrored.z)
            further = missing_v * missing_l * dr.inv_pi / dr.maximum(missing, 1e-9)
            f0 = dr.max(f0)
            fresnel = self._fresnel(f0, dr.dot(v, dr.normalize(v + mirrored)), f90)
            value = specular * (1.0 - fresnel) + (1.0 - self._further(f0, f90, missing)) * further
            return value, dr.lerp(mirrored.z * dr.inv_pi, density, _COAT_GLOSSY)

        def _absorbed(self, si: Any, towards: Any) -> Any:
            """What is left of light after the way to here through a solid body, Color3f."""
            within = dr.select(dr.dot(si.n, towards) < 0.0, si.t, 0.0)
            return dr.exp(-self.looks.extinction * within)

        def _coat(self, si: Any, cosine: Any, active: Any) -> tuple[Any, Any, Any]:
            """The coat's share, the chance to sample it, and its roughness."""
            strength, roughness = self.looks.coat(si, active)
            share = strength * self._fresnel(0.04, cosine)
            return share, dr.select(strength > 0.0, dr.clip(share, 0.15, 0.9), 0.0), dr.maximum(roughness, dr.sqrt(ALPHA_LEAST))

        def _chances(self, si: Any, active: Any, v: Any) -> tuple[Any, Any]:
            """With which probability to go straight on, and, otherwise, to sample the specular part."""
            base = mi.luminance(self.looks.base(si, active))
            _, metallic = self.looks.roughness_metallic(si, active)
            straight = dr.clip(dr.mean(self._passing(si, active)), 0.0, 1.0) if self.looks.may_pass else mi.Float(0.0)
            f_d = dr.max(self._dielectric(si, v.z, active))
            specular = (1.0 - metallic) * f_d + metallic * self._fresnel(base, v.z)
            diffuse = (1.0 - metallic) * (1.0 - self.looks.transmission(si, active)) * (1.0 - f_d) * base
            share = dr.clip(specular / dr.maximum(specular + diffuse, 1e-9), 0.15, 0.95)
            return straight, share

        def _value_and_density(self, si: Any, wo: Any, active: Any) -> tuple[Any, Any]:
            """BSDF times cosine (Color3f) and density per steradian of scattering into `wo`, as `sample` does it."""
            frame, n, towards = self._frame(si)
            out = si.to_world(wo)
            v, l = frame.to_local(towards), frame.to_local(out)
            base, opacity = self.looks.base(si, active), self.looks.opacity(si, active)
            roughness, metallic = self.looks.roughness_metallic(si, active)
            alpha = dr.maximum(roughness * roughness, ALPHA_LEAST)
            good = active & (v.z > 0.0) & (l.z > 0.0) & (dr.dot(out, n) > 0.0)
            specular, density = self._mirror(v, l, alpha)
            cosine = dr.dot(v, dr.normalize(v + l))
            f_d = self._dielectric(si, cosine, active)
            missing_v, grazing_v, missing, grazing = self._albedo(roughness, v.z)
            missing_l, grazing_l, _, _ = self._albedo(roughness, l.z)
            f0, f90 = self._dielectric(si, 1.0, active), self.looks.specular(si, active)[0]
            further = missing_v * missing_l * dr.inv_pi / dr.maximum(missing, 1e-9)
            left = self._left(f0, f90, missing_v, grazing_v, missing) * self._left(f0, f90, missing_l, grazing_l, missing)
            left /= dr.maximum(self._left(f0, f90, missing, grazing, missing), 1e-6)
            thin = 0.0 if self.looks.solid else self.looks.transmission(si, active)
            diffuse = left * (1.0 - thin) * base * dr.inv_pi
            dielectric = diffuse + f_d * specular + self._further(f0, f90, missing) * further
            metal = specular * self._fresnel(base, cosine) + self._further(base, 1.0, missing) * further
            value = (1.0 - metallic) * dielectric + metallic * metal
            straight, share = self._chances(si, active, v)
            density = share * density + (1.0 - share) * l.z * dr.inv_pi
            if self.scatters:
                through, chance = self._share_through(si, active), self._chance_through(si, active)
                beyond = active & (v.z > 0.0) & (l.z < 0.0) & (dr.dot(out, n) < 0.0)
                if self.looks.solid:
                    plain = mi.Color3f(metallic * metal + (1.0 - metallic - through) * dielectric)
                    glass, glass_density = self._glass(v, l, self._glass_alpha(alpha), self._index(si, towards))
                    value = dr.select(beyond, through * glass * base, plain + through * glass)
                else:
                    glass, glass_density = self._beyond(v, l, alpha, roughness, f0, f90)
                    value, glass_density = dr.select(beyond, through * glass * base, value), dr.select(beyond, glass_density, 0.0)
                density = dr.select(beyond, 0.0, (1.0 - chance) * density) + chance * glass_density
                good |= beyond
                l = mi.Vector3f(l.x, l.y, dr.abs(l.z))
            if self.looks.coated:
                coat_frame, _, _ = self._frame(si, of_coat=True)
                cv, cl = coat_frame.to_local(towards), coat_frame.to_local(out)
                veil, pick, coat_roughness = self._coat(si, cv.z, active)
                coat_value, coat_density = self._mirror(cv, cl, dr.square(coat_roughness))
                missing_v, _, missing, _ = self._albedo(coat_roughness, cv.z)
                missing_l, _, _, _ = self._albedo(coat_roughness, cl.z)
                coat_value += missing_v * missing_l * dr.inv_pi / dr.maximum(missing, 1e-9)
                coat_density = dr.lerp(cl.z * dr.inv_pi, coat_density, _COAT_GLOSSY)
                mirrors = active & (cv.z > 0.0) & (cl.z > 0.0) & (dr.dot(out, n) > 0.0)
                added = dr.select(mirrors, veil * coat_value * cl.z * opacity, 0.0)
                total = dr.select(good, (1.0 - veil) * value * opacity * l.z, 0.0) + added
                density = dr.select(good, (1.0 - pick) * density, 0.0) + dr.select(mirrors, pick * coat_density, 0.0)
                if self.looks.solid:
                    total *= self._absorbed(si, towards)
                return dr.select(active, total, 0.0), dr.select(active, (1.0 - straight) * density, 0.0)
            if self.looks.solid:
                value *= self._absorbed(si, towards)
            if self.looks.unlit:
                value = mi.Color3f(0.0)
            return dr.select(good, value * opacity * l.z, 0.0), dr.select(good, (1.0 - straight) * density, 0.0)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> tuple[Any, Any]:
            """See `mi.BSDF`."""
            frame, n, towards = self._frame(si)
            v = frame.to_local(towards)
            straight, share = self._chances(si, active, v)
            roughness, _ = self.looks.roughness_metallic(si, active)
            alpha = dr.maximum(roughness * roughness, ALPHA_LEAST)
            passes = sample1 < straight
            rest = (sample1 - straight) / dr.maximum(1.0 - straight, 1e-9)
            if self.looks.coated:
                coat_frame, _, _ = self._frame(si, of_coat=True)
                cv = coat_frame.to_local(towards)
                _, pick, coat_roughness = self._coat(si, cv.z, active)
                coat_alpha, off_coat, glossy = dr.square(coat_roughness), rest < pick, rest < pick * _COAT_GLOSSY
                rest = (rest - pick) / dr.maximum(1.0 - pick, 1e-9)
                coat_half, _ = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, coat_alpha, coat_alpha, True).sample(cv, sample2)
                mirrored = dr.select(glossy, mi.reflect(cv, coat_half), mi.warp.square_to_cosine_hemisphere(sample2))
            distribution = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, alpha, alpha, True)
            h, _ = distribution.sample(v, sample2)
            l = dr.select(rest < share, mi.reflect(v, h), mi.warp.square_to_cosine_hemisphere(sample2))
            out = frame.to_world(l)
            leaves = l.z > 0.0
            if self.scatters:
                chance = self._chance_through(si, active)
                of_lobe, within = rest < chance, rest / dr.maximum(chance, 1e-9)
                if self.looks.solid:
                    glass_alpha = self._glass_alpha(alpha)
                    facet, _ = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, glass_alpha, glass_alpha, True).sample(v, sample2)
                    fresnel, cosine_t, _, eta_ti = mi.fresnel(dr.dot(v, facet), self._index(si, towards))
                    reflects = within < fresnel
                    lobe = dr.select(reflects, mi.reflect(v, facet), mi.refract(v, facet, cosine_t, eta_ti))
                    right = dr.select(reflects, lobe.z > 0.0, lobe.z < 0.0)
                else:
                    lobe = dr.select(within < _COAT_GLOSSY, mi.reflect(v, h), mi.warp.square_to_cosine_hemisphere(sample2))
                    right = lobe.z > 0.0
                    lobe = mi.Vector3f(lobe.x, lobe.y, -lobe.z)
                after = (rest - chance) / dr.maximum(1.0 - chance, 1e-9)
                l = dr.select(after < share, mi.reflect(v, h), mi.warp.square_to_cosine_hemisphere(sample2))
                l, leaves = dr.select(of_lobe, lobe, l), dr.select(of_lobe, right, l.z > 0.0)
                out = frame.to_world(l)
            if self.looks.coated:
                out = dr.select(off_coat, coat_frame.to_world(mirrored), out)
                leaves = dr.select(off_coat, (mirrored.z > 0.0) & (dr.dot(out, n) > 0.0), leaves)
            bs = dr.zeros(mi.BSDFSample3f)
            bs.wo = dr.select(passes, -si.wi, si.to_local(out))
            value, density = self._value_and_density(si, bs.wo, active)
            density = dr.select(leaves, density, 0.0)
            bs.pdf = dr.select(passes, straight, density)
            bs.eta = 1.0
            component, kind = mi.UInt32(1), mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            if self.scatters:
                crosses = dr.dot(si.to_world(bs.wo), si.n) * dr.dot(towards, si.n) < 0.0
                component = dr.select(crosses, mi.UInt32(2), component)
                kind = dr.select(crosses, mi.UInt32(+mi.BSDFFlags.GlossyTransmission), kind)
            bs.sampled_component = dr.select(passes, mi.UInt32(0), component)
            bs.sampled_type = dr.select(passes, mi.UInt32(+mi.BSDFFlags.Null), kind)
            weight = dr.select(density > 0.0, value / dr.maximum(density, 1e-30), 0.0)
            if self.looks.may_pass:
                weight = dr.select(passes, self._passing(si, active) / dr.maximum(straight, 1e-9), weight)
            return bs, dr.select(active, weight, 0.0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """See `mi.BSDF`."""
            return self._value_and_density(si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """See `mi.BSDF`."""
            return self._value_and_density(si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            """See `mi.BSDF`."""
            return self._value_and_density(si, wo, active)

        def eval_null_transmission(self, si: Any, active: Any = True) -> Any:
            """See `mi.BSDF`."""
            return dr.select(active, self._passing(si, active), 0.0) if self.looks.may_pass else mi.Color3f(0.0)

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            """The base colour, which the film calls albedo."""
            return self.looks.base(si, active)

        def to_string(self) -> str:
            """See `mi.BSDF`."""
            return f"GltfBsdf[{self.looks.number}]"

    return GltfBsdf
