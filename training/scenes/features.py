"""Integrators that return radiance together with albedo and normal, sample by sample.

make(settings) gives an integrator whose image has the channels R,G,B, albedo R,G,B, normal X,Y,Z.
Import only after backend.load(): the classes derive from the running Mitsuba variant.

The features belong to the *recorded* vertex of a camera path:
  follow = "first"   the first hit, whatever it is (but for mere bounds of a medium)
           "cutout"  the first hit, but null lobes (masks, thin glass) are passed
           "delta"   the first hit with a non-delta lobe: mirrors and glass are followed as the
                     BSDF is sampled, the albedo multiplied by the throughput on the way
  albedo   diffuse reflectance where the material has a diffuse lobe, otherwise the weight of one
           BSDF sample; clamped to [0, 1]
  emitter = "one" | "colour" (min(radiance, 1)) | "surface" (as if it did not shine)
  miss    = "zero" | "one" | "env" (min(radiance, 1))
  normal   signed world-space shading normal, 0 where nothing was hit; faceforward turns it
           towards the ray that hit
  volume  = "ignore" | "scatter": with "scatter" a path that scatters in a medium before the
           recorded surface records the single-scattering albedo and normal 0
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

MAX_FOLLOW = 6  # delta bounces before the hit is recorded as it is


@dataclass(frozen=True)
class FeatureSettings:
    follow: str = "delta"
    emitter: str = "one"
    miss: str = "zero"
    faceforward: bool = False
    volume: str = "ignore"


def _has(flags, wanted):
    return mi.has_flag(flags, wanted)


def _not(mask):
    """Negation of a mask, which is a plain bool in scalar variants."""
    return not mask if isinstance(mask, bool) else ~mask


def _emitted(emitter, si, active):
    """Radiance of an emitter towards si.wi; 0 where there is none."""
    return mi.Color3f(0.0) if emitter is None else emitter.eval(si, active)


def _exists(pointer):
    """Mask of non-null instance pointers."""
    return pointer is not None if not dr.is_jit_v(mi.Float) else pointer != None  # noqa: E711


# Scalar variants have null pointers where the others have masked lanes.

def _bsdf(si, ray):
    return si.bsdf(ray) if dr.is_jit_v(mi.Float) or si.is_valid() else None


def _emitter_pdf(scene, ref, ds, active):
    """Density of sampling the emitter of ds from ref."""
    if not dr.is_jit_v(mi.Float) and (ds.emitter is None or not active):
        return mi.Float(0.0)
    return scene.pdf_emitter_direction(ref, ds, active)


def _flags(bsdf):
    return mi.UInt32(0) if bsdf is None else bsdf.flags()


def _diffuse(bsdf, si, active):
    return mi.Color3f(0.0) if bsdf is None else bsdf.eval_diffuse_reflectance(si, active)


def _scatter(bsdf, si, wo, u1, u2, active):
    """BSDF value and density towards wo, and one sample of it with its weight."""
    if bsdf is None:
        return mi.Color3f(0.0), mi.Float(0.0), dr.zeros(mi.BSDFSample3f), mi.Color3f(0.0)
    return bsdf.eval_pdf_sample(mi.BSDFContext(), si, wo, u1, u2, active)


class _Recorder:
    """One step of the walk that finds the recorded vertex. All arguments are per path."""

    def __init__(self, s: FeatureSettings):
        self.s = s

    def surface(self, si, emitted, on_emitter, diffuse, bs, weight, flags, ray_d,
                tint, bounce):
        """Returns (stop, albedo, normal, tint of the next ray). emitted: radiance towards the ray.

        diffuse: diffuse reflectance; bs, weight, flags: BSDF sample, its weight, BSDF flags.
        """
        s = self.s
        white = mi.Color3f(1.0)
        hit = si.is_valid()
        null = _has(bs.sampled_type, mi.BSDFFlags.Null)
        delta = _not(_has(flags, mi.BSDFFlags.Smooth))
        if s.follow == "delta":
            go_on = null | delta
        elif s.follow == "cutout":
            go_on = null
        else:
            go_on = mi.Bool(False)
        empty = delta & _not(_has(flags, mi.BSDFFlags.DeltaReflection))
        go_on = go_on | (null & empty)  # the surface only bounds a medium
        shines = on_emitter & hit & (dr.max(emitted) > 0)
        if s.emitter == "surface":
            shines = mi.Bool(False)
        go_on = go_on & hit & _not(shines) & (bounce < MAX_FOLLOW) & (dr.max(weight) > 0)

        # Radiance is scaled by 1/eta^2 when it enters glass; a reflectance is not.
        through = _has(bs.sampled_type, mi.BSDFFlags.DeltaTransmission)
        weight = weight * dr.select(through, bs.eta * bs.eta, 1.0)
        weight = dr.clip(weight, 0.0, 1.0)
        own = dr.select(_has(flags, mi.BSDFFlags.Diffuse), dr.clip(diffuse, 0.0, 1.0), weight)
        glow = white if s.emitter == "one" else dr.clip(emitted, 0.0, 1.0)
        own = dr.select(shines, glow, own)
        missed = {"zero": mi.Color3f(0.0), "one": white,
                  "env": dr.clip(emitted, 0.0, 1.0)}[s.miss]
        albedo = tint * dr.select(hit, own, missed)

        n = si.sh_frame.n
        if s.faceforward:
            n = dr.select(dr.dot(n, ray_d) > 0, -n, n)
        normal = dr.select(hit, mi.Vector3f(n), mi.Vector3f(0.0))
        return _not(go_on), albedo, normal, tint * weight


def _names() -> list[str]:
    return ["albedo.R", "albedo.G", "albedo.B", "normal.X", "normal.Y", "normal.Z"]


def _finite(v):
    """v, or 0 where a component is not finite: a sample that a material's corner case spoiled."""
    return dr.select(dr.all(dr.isfinite(v)), v, 0.0)


def _channels(albedo, normal):
    a, n = _finite(albedo), _finite(normal)
    return [a.x, a.y, a.z, n.x, n.y, n.z]


def _mis(a, b):
    """Power heuristic; a, b: densities."""
    a2 = a * a
    return a2 / dr.maximum(dr.fma(b, b, a2), 1e-30)


class FeaturePath(mi.SamplingIntegrator):
    """Path tracer (next-event estimation, MIS) whose own paths give the features. No media.

    aimed: at how many vertices of a path lights are sampled, None: at all; beyond them paths meet
    lights by chance, and point and spot lights never.
    """

    def __init__(self, props=None, settings: FeatureSettings | None = None, max_depth: int = 8,
                 rr_depth: int = 4, aimed: int | None = None):
        super().__init__(props if props is not None else mi.Properties())
        self.recorder = _Recorder(settings or FeatureSettings())
        self.max_depth, self.rr_depth = max_depth, rr_depth
        self.aimed = max_depth if aimed is None else aimed

    def aov_names(self):
        return _names()

    @dr.syntax
    def sample(self, scene, sampler, ray_, medium=None, active=True):
        ray = mi.Ray3f(ray_)
        active = mi.Bool(active)
        looking = mi.Bool(active)       # no vertex recorded yet
        valid = mi.Bool(False)
        radiance = mi.Color3f(0.0)
        beta = mi.Color3f(1.0)
        tint = mi.Color3f(1.0)
        albedo = mi.Color3f(0.0)
        normal = mi.Vector3f(0.0)
        eta = mi.Float(1.0)
        depth = mi.UInt32(0)
        prev_si = dr.zeros(mi.Interaction3f)
        prev_pdf = mi.Float(1.0)
        by_chance = mi.Bool(True)       # lights were not sampled at the last vertex

        while active:
            si = scene.ray_intersect(ray, mi.RayFlags.All, depth == 0, active)
            emitter = si.emitter(scene, active)
            emitted = _emitted(emitter, si, active)
            ds = mi.DirectionSample3f(scene, si, prev_si)
            pdf = _emitter_pdf(scene, prev_si, ds, active & _not(by_chance))
            radiance += beta * emitted * dr.select(by_chance, 1.0, _mis(prev_pdf, pdf))

            hit = active & si.is_valid()
            go = hit & (depth + 1 < self.max_depth)
            bsdf = _bsdf(si, ray)
            flags = _flags(bsdf)
            lit = go & _has(flags, mi.BSDFFlags.Smooth) & (depth < self.aimed)
            ds, em_weight = scene.sample_emitter_direction(si, sampler.next_2d(active), True, lit)
            wo = si.to_local(ds.d)
            val, val_pdf, bs, weight = _scatter(
                bsdf, si, wo, sampler.next_1d(active), sampler.next_2d(active), hit)
            near = beta * val * em_weight * dr.select(ds.delta, 1.0, _mis(ds.pdf, val_pdf))
            radiance += dr.select(lit & (ds.pdf != 0.0), near, 0.0)

            looks = active & looking
            diffuse = _diffuse(bsdf, si, looks & hit)
            stop, a, n, next_tint = self.recorder.surface(
                si, emitted, _exists(emitter), diffuse, bs, weight, flags, ray.d, tint, depth)
            stop = stop | _not(go)
            albedo = dr.select(looks & stop, a, albedo)
            normal = dr.select(looks & stop, n, normal)
            tint = dr.select(looks, next_tint, tint)
            looking = looking & _not(stop)
            valid = valid | hit

            beta *= weight
            eta *= dr.select(hit, bs.eta, 1.0)
            prev_si = mi.Interaction3f(si)
            prev_pdf = bs.pdf
            by_chance = (_has(bs.sampled_type, mi.BSDFFlags.Delta)
                         | (depth >= self.aimed))
            ray = si.spawn_ray(si.to_world(bs.wo))
            depth += dr.select(hit, mi.UInt32(1), mi.UInt32(0))
            top = dr.max(beta)
            keep = dr.minimum(top * eta * eta, 0.95)
            play = depth >= self.rr_depth
            survives = _not(play) | (sampler.next_1d(active) < keep)
            beta *= dr.select(play, 1.0 / dr.maximum(keep, 1e-8), 1.0)
            active = go & (top > 0.0) & survives

        return _finite(radiance), valid, _channels(albedo, normal)


class FeatureVolume(mi.SamplingIntegrator):
    """Any other integrator for the radiance (None: it is 0), and a walk of its own for the
    features."""

    def __init__(self, inner, settings: FeatureSettings, props=None):
        super().__init__(props if props is not None else mi.Properties())
        self.inner, self.settings, self.recorder = inner, settings, _Recorder(settings)

    def aov_names(self):
        return _names()

    def sample(self, scene, sampler, ray, medium=None, active=True):
        radiance, valid = mi.Color3f(0.0), mi.Bool(active)
        if self.inner:
            radiance, valid, _ = self.inner.sample(scene, sampler, ray, medium, active)
        a, n = self.walk(scene, sampler, ray, medium, active)
        return _finite(radiance), valid, _channels(a, n)

    @dr.syntax
    def walk(self, scene, sampler, ray_, medium_, active_):
        ray = mi.Ray3f(ray_)
        active = mi.Bool(active_)
        medium = mi.MediumPtr(medium_) if dr.is_jit_v(mi.Float) else medium_
        tint = mi.Color3f(1.0)
        albedo = mi.Color3f(0.0)
        normal = mi.Vector3f(0.0)
        bounce = mi.UInt32(0)
        while active:
            si = scene.ray_intersect(ray, mi.RayFlags.All, bounce == 0, active)
            emitter = si.emitter(scene, active)
            emitted = _emitted(emitter, si, active)
            bsdf = _bsdf(si, ray)
            hit = active & si.is_valid()
            zero = mi.Vector3f(0.0, 0.0, 1.0)
            _, _, bs, weight = _scatter(bsdf, si, zero, sampler.next_1d(active),
                                        sampler.next_2d(active), hit)
            stop, a, n, next_tint = self.recorder.surface(
                si, emitted, _exists(emitter), _diffuse(bsdf, si, hit), bs, weight,
                _flags(bsdf), ray.d, tint, bounce)
            floats, t = _free_flight(medium, ray, sampler.next_1d(active), active)
            cut = floats[0] & (t < si.t)
            if self.settings.volume == "ignore":
                cut = mi.Bool(False)
            a = dr.select(cut, tint * floats[1], a)
            n = dr.select(cut, mi.Vector3f(0.0), n)
            stop = stop | cut
            albedo = dr.select(active & stop, a, albedo)
            normal = dr.select(active & stop, n, normal)
            tint = next_tint
            medium = _next_medium(si, ray.d, medium, hit)
            ray = si.spawn_ray(si.to_world(bs.wo))
            bounce += mi.UInt32(1)
            active = active & _not(stop)
        return albedo, normal


def _free_flight(medium, ray, u, active):
    """((mask: inside a medium, single-scattering albedo), distance to the next scattering)."""
    if medium is None:
        return (mi.Bool(False), mi.Color3f(0.0)), mi.Float(dr.inf)
    inside = active & _exists(medium)
    mei = medium.sample_interaction(ray, u, mi.UInt32(0), inside)
    total = dr.maximum(mei.sigma_t, 1e-12)
    return (inside, dr.clip(mei.sigma_s / total, 0.0, 1.0)), mei.t


def _next_medium(si, d, medium, hit):
    """The medium behind a surface that has one on a side of its own."""
    if not dr.is_jit_v(mi.Float):
        return si.target_medium(d) if hit and si.is_medium_transition() else medium
    return dr.select(hit & si.is_medium_transition(), si.target_medium(d), medium)


def make(settings: FeatureSettings, max_depth: int, volumes: bool = False,
         aimed: int | None = None):
    """Integrator with the nine channels; volumes: the scene holds participating media (lights are
    sampled everywhere then); aimed: as of FeaturePath."""
    if not volumes:
        return FeaturePath(None, settings, max_depth, aimed=aimed)
    inner = mi.load_dict({"type": "volpath", "max_depth": max_depth + 4, "rr_depth": 5})
    return FeatureVolume(inner, settings)
