//! How a surface scatters light when it is followed beyond direct light: what part goes where (a bidirectional scattering
//! distribution), and directions drawn from it.
//!
//! An opaque surface scatters evenly (Lambert), mirrors a part, or both; a clear one reflects and refracts. Mirrors and glass are
//! perfect, or rough (GGX).

use crate::fresnel::{incidence, part, reflected, refracted};
use crate::layout::Surface;
use crate::microfacet::Ggx;
use crate::scene_data::DIELECTRIC;
use crate::scene_words::SceneWords;
use crate::vector::{Vector, add, dot, greatest, negated, normalized, scaled, sub};
use crate::warp::{Basis, ONE_OVER_PI, hemisphere, unpacked};

/// Below this a surface counts as perfectly smooth: a lobe so narrow that `f32` hardly resolves it.
pub(crate) const LEAST_ALPHA: f32 = 1.0e-3;

/// What a surface does with light.
#[derive(Clone, Copy)]
pub(crate) struct Bsdf {
    /// Part that is scattered evenly.
    pub(crate) diffuse: Vector,
    /// Part that is mirrored, or tint of what is refracted.
    second: Vector,
    clear: bool,
    /// Whether what is followed is a photon, from the light: power does not change where it is refracted, as radiance does.
    of_light: bool,
    /// Index on the side that the path came from over the index behind.
    ratio: f32,
    /// `None` where it is smooth.
    rough: Option<Ggx>,
    /// Probability that a direction is drawn from the mirror.
    pub(crate) mirror_share: f32,
    normal: Vector,
    geometric_normal: Vector,
    basis: Basis,
    /// Towards where the path came from, local.
    view: Vector,
}

/// A direction in which a path goes on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scattered {
    pub(crate) direction: Vector,
    /// What is scattered there, times the cosine, over the density.
    pub(crate) weight: Vector,
    /// By solid angle; 0 where the direction could be no other.
    pub(crate) density: f32,
    /// 1 on the side that the path came from, -1 behind the surface.
    pub(crate) side: f32,
}

impl Bsdf {
    pub(crate) fn of(scene: &SceneWords<'_>, surface: &Surface) -> Bsdf {
        let material = scene.scattering(surface.material);
        let clear = material.kind == DIELECTRIC;
        let diffuse = if clear { [0.0; 3] } else { surface.scattering };
        let basis = Basis::around(surface.normal);
        let (even, mirrored) = (greatest(diffuse), greatest(material.second));
        let total = even + mirrored;
        let mut view = basis.to_local(unpacked(surface.incoming));
        // The path came from this side, even where the packed direction says otherwise by its rounding.
        view[2] = if view[2] > 1e-4 { view[2] } else { 1e-4 };
        Bsdf {
            diffuse,
            second: material.second,
            clear,
            of_light: false,
            ratio: surface.scattering[2],
            rough: (material.alpha >= LEAST_ALPHA).then_some(Ggx { alpha: material.alpha }),
            mirror_share: if total > 0.0 { mirrored / total } else { 0.0 },
            normal: surface.normal,
            geometric_normal: surface.geometric_normal,
            basis,
            view: normalized(view),
        }
    }

    /// The same surface, met by a photon.
    pub(crate) fn of_light(self) -> Bsdf {
        Bsdf { of_light: true, ..self }
    }

    /// What scatters evenly, alone; `None` where nothing does.
    pub(crate) fn even(&self) -> Option<Bsdf> {
        let alone = Bsdf { second: [0.0; 3], rough: None, mirror_share: 0.0, ..*self };
        (greatest(self.diffuse) > 0.0).then_some(alone)
    }

    /// The mirror, or the clear body, alone; `None` where there is none.
    pub(crate) fn mirror(&self) -> Option<Bsdf> {
        let alone = Bsdf { diffuse: [0.0; 3], mirror_share: 1.0, ..*self };
        (self.clear || greatest(self.second) > 0.0).then_some(alone)
    }

    /// Whether some light comes from directions that a sample of a light may have.
    pub(crate) fn scatters(&self) -> bool {
        let mirrors = self.clear || greatest(self.second) > 0.0;
        greatest(self.diffuse) > 0.0 || (self.rough.is_some() && mirrors)
    }

    /// What comes back of light from a direction, times its cosine, and the density with which [`Bsdf::scatter`] draws that direction.
    /// What a perfect mirror does is left out.
    pub(crate) fn evaluate(&self, direction: Vector) -> (Vector, f32) {
        let nothing = ([0.0; 3], 0.0);
        let l = self.basis.to_local(direction);
        let above = dot(self.geometric_normal, direction) > 0.0;
        if above != (l[2] > 0.0) {
            return nothing;
        }
        if self.clear {
            return self.rough.map_or(nothing, |ggx| self.evaluate_clear(ggx, l));
        }
        if !above {
            return nothing;
        }
        let even = l[2] * ONE_OVER_PI;
        let mut sent = scaled(self.diffuse, even);
        let mut density = (1.0 - self.mirror_share) * even;
        if let Some(ggx) = self.rough {
            let v = self.view;
            let facet = normalized(add(v, l));
            let both = ggx.seen_by_both(v, l) * ggx.density(facet);
            sent = add(sent, scaled(self.second, both / (4.0 * v[2])));
            let mirrored = ggx.facet_density(v, facet) / (4.0 * dot(v, facet));
            density += self.mirror_share * mirrored;
        }
        (sent, density)
    }

    fn evaluate_clear(&self, ggx: Ggx, l: Vector) -> (Vector, f32) {
        let v = self.view;
        if l[2] > 0.0 {
            let facet = normalized(add(v, l));
            let along = dot(v, facet);
            let reflectance = part(least_one(along), self.ratio).reflectance;
            let both = ggx.seen_by_both(v, l) * ggx.density(facet);
            let sent = reflectance * (both / (4.0 * v[2]));
            let density = reflectance * (ggx.facet_density(v, facet) / (4.0 * along));
            return ([sent; 3], density);
        }
        // Snell's law for facets: the normal lies along the difference of the two directions, each times its index.
        let mut facet = normalized(add(scaled(v, self.ratio), l));
        if facet[2] < 0.0 {
            facet = negated(facet);
        }
        let (along, behind) = (dot(v, facet), dot(l, facet));
        if !(along > 0.0 && behind < 0.0) {
            return ([0.0; 3], 0.0);
        }
        let through = 1.0 - part(least_one(along), self.ratio).reflectance;
        let bend = self.ratio * along + behind;
        let jacobian = -behind / (bend * bend);
        let density = through * (ggx.facet_density(v, facet) * jacobian);
        let below = [l[0], l[1], -l[2]];
        let both = ggx.seen_by_both(v, below) * ggx.density(facet);
        let sent = through * (((both * along) / v[2]) * jacobian);
        let sent = scaled(self.second, sent * self.compression());
        if density.is_finite() { (sent, density) } else { ([0.0; 3], 0.0) }
    }

    /// By how much radiance changes where it is refracted (Veach 1997, section 5.2).
    fn compression(&self) -> f32 {
        if self.of_light { 1.0 } else { self.ratio * self.ratio }
    }

    /// Draws the direction in which a path goes on; `incoming` is that of its ray. `None` where it ends.
    pub(crate) fn scatter(
        &self,
        incoming: Vector,
        choice: f32,
        numbers: [f32; 2],
    ) -> Option<Scattered> {
        match (self.clear, self.rough) {
            (true, None) => Some(self.scatter_clear(incoming, choice)),
            (true, Some(ggx)) => self.scatter_rough_clear(ggx, choice, numbers),
            (false, _) => self.scatter_opaque(incoming, choice, numbers),
        }
    }

    fn scatter_opaque(
        &self,
        incoming: Vector,
        choice: f32,
        numbers: [f32; 2],
    ) -> Option<Scattered> {
        let mirrored = choice < self.mirror_share;
        if mirrored && greatest(self.second) <= 0.0 {
            return None;
        }
        if mirrored && self.rough.is_none() {
            let mut normal = self.normal;
            let mut direction = reflected(incoming, normal, incidence(incoming, normal));
            if dot(direction, self.geometric_normal) <= 0.0 {
                // The mirrored ray would go into the surface: the flat mirror does not.
                normal = self.geometric_normal;
                direction = reflected(incoming, normal, incidence(incoming, normal));
            }
            let weight = scaled(self.second, 1.0 / self.mirror_share);
            let direction = normalized(direction);
            return Some(Scattered { direction, weight, density: 0.0, side: 1.0 });
        }
        let local = match self.rough {
            Some(ggx) if mirrored => {
                let facet = ggx.facet(self.view, numbers);
                mirror(self.view, facet)
            }
            _ => hemisphere(numbers),
        };
        let direction = normalized(self.basis.to_world(local));
        if self.rough.is_none() {
            if dot(direction, self.geometric_normal) <= 0.0 || greatest(self.diffuse) <= 0.0 {
                return None;
            }
            let share = 1.0 - self.mirror_share;
            let weight = scaled(self.diffuse, 1.0 / share);
            let density = share * (local[2] * ONE_OVER_PI);
            return Some(Scattered { direction, weight, density, side: 1.0 });
        }
        let (sent, density) = self.evaluate(direction);
        if density <= 0.0 {
            return None;
        }
        let weight = scaled(sent, 1.0 / density);
        Some(Scattered { direction, weight, density, side: 1.0 })
    }

    fn scatter_clear(&self, incoming: Vector, choice: f32) -> Scattered {
        let (mut normal, geometric_normal) = (self.normal, self.geometric_normal);
        let mut cosine = incidence(incoming, normal);
        let mut parting = part(cosine, self.ratio);
        let out = refracted(incoming, normal, cosine, self.ratio, parting.cosine);
        let above = dot(reflected(incoming, normal, cosine), geometric_normal) > 0.0;
        let below = parting.reflectance >= 1.0 || dot(out, geometric_normal) < 0.0;
        if !(above && below) {
            normal = geometric_normal;
            cosine = incidence(incoming, normal);
            parting = part(cosine, self.ratio);
        }
        let (direction, weight, side) = if choice < parting.reflectance {
            (reflected(incoming, normal, cosine), [1.0; 3], 1.0)
        } else {
            let out = refracted(incoming, normal, cosine, self.ratio, parting.cosine);
            (out, scaled(self.second, self.compression()), -1.0)
        };
        let direction = normalized(direction);
        Scattered { direction, weight, density: 0.0, side }
    }

    fn scatter_rough_clear(&self, ggx: Ggx, choice: f32, numbers: [f32; 2]) -> Option<Scattered> {
        let facet = ggx.facet(self.view, numbers);
        let cosine = least_one(dot(self.view, facet));
        let parting = part(cosine, self.ratio);
        let back = negated(self.view);
        let local = if choice < parting.reflectance {
            mirror(self.view, facet)
        } else {
            normalized(refracted(back, facet, cosine, self.ratio, parting.cosine))
        };
        let direction = normalized(self.basis.to_world(local));
        let side = if choice < parting.reflectance { 1.0 } else { -1.0 };
        if local[2] * side <= 0.0 || dot(direction, self.geometric_normal) * side <= 0.0 {
            return None;
        }
        let (_, density) = self.evaluate(direction);
        if density <= 0.0 {
            return None;
        }
        // What is drawn in proportion to the facets that are seen leaves those seen from both sides.
        let l = [local[0], local[1], local[2].abs()];
        let both = ggx.seen_by_both(self.view, l) / ggx.seen(self.view);
        let tint = if side > 0.0 { [1.0; 3] } else { scaled(self.second, self.compression()) };
        Some(Scattered { direction, weight: scaled(tint, both), density, side })
    }
}

/// The mirrored direction of `v`.
fn mirror(v: Vector, facet: Vector) -> Vector {
    sub(scaled(facet, 2.0 * dot(v, facet)), v)
}

fn least_one(cosine: f32) -> f32 {
    if cosine < 1.0 { cosine } else { 1.0 }
}
