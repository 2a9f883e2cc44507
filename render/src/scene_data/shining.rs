//! Which triangles, spheres and capsules shine, and with which power.

use super::instances::{InstanceTable, Shown};
use super::{AppearanceError, EMITTER_WORDS, NONE};
use crate::material::Material;
use splitplane_core::mesh::Mesh;
use std::collections::HashMap;

/// Most triangles that shine of a scene of instances, which need not be many in its geometries.
const MOST_EMITTERS: usize = 1 << 26;

/// A triangle or a shape with its instance, and its power.
pub(super) type Source = ([u32; 2], f64);

/// What is known of materials that shine.
pub(super) struct Shining<'a> {
    material_of: &'a [u32],
    /// By material: the sum of the parts of its radiance; `None` where it does not shine.
    radiance: Vec<Option<f64>>,
    /// By the first triangle of a geometry and their number: whether one of them shines in its own material. Many instances share an answer.
    own: HashMap<(u32, u32), bool>,
}

impl<'a> Shining<'a> {
    pub(super) fn new(materials: &[Material], material_of: &'a [u32]) -> Shining<'a> {
        let radiance = materials
            .iter()
            .map(|m| m.shines().then(|| m.emission.iter().map(|part| f64::from(*part)).sum()))
            .collect();
        Shining { material_of, radiance, own: HashMap::new() }
    }

    /// By material the radiance, to be compared later.
    pub(super) fn into_radiance(self) -> Vec<Option<f64>> {
        self.radiance
    }

    /// Whether all materials shine as they did then.
    pub(super) fn has_radiance(&self, then: &[Option<f64>]) -> bool {
        let bits = |own: &Option<f64>| own.map(f64::to_bits);
        self.radiance.iter().map(bits).eq(then.iter().map(bits))
    }

    /// Whether something of an instance shines.
    pub(super) fn has(&mut self, shown: &Shown) -> bool {
        if self.is_dark() {
            return false;
        }
        if shown.material != NONE || shown.has_shapes() {
            let material = if shown.material == NONE { 0 } else { shown.material };
            return self.radiance(material).is_some();
        }
        let (first, count) = (shown.first_triangle, shown.triangles);
        if let Some(known) = self.own.get(&(first, count)) {
            return *known;
        }
        let shines = (0..count).any(|t| self.own((first + t) as usize).is_some());
        self.own.insert((first, count), shines);
        shines
    }

    /// The triangles of a mesh that shine.
    pub(super) fn of_mesh(&self, mesh: &Mesh<'_>) -> Vec<Source> {
        if self.is_dark() {
            return Vec::new();
        }
        let source = |t| {
            let power = self.own(t)? * area(&mesh.triangle(t));
            Some(([t as u32, 0], is_powerful(power)?))
        };
        (0..mesh.len()).filter_map(source).collect()
    }

    /// What shines of instances, in the order of their names.
    pub(super) fn of_instances(
        &mut self,
        mesh: &Mesh<'_>,
        table: &InstanceTable,
    ) -> Result<Vec<Source>, AppearanceError> {
        let mut powers: Vec<Source> = Vec::new();
        if self.is_dark() {
            return Ok(powers);
        }
        for (instance, shown) in table.all() {
            if !self.has(shown) {
                continue;
            }
            let all = (shown.material != NONE).then_some(shown.material);
            if shown.has_shapes() {
                let radiance = self.radiance(all.unwrap_or(0));
                powers.extend(table.areas(shown).zip(0..).filter_map(|(area, primitive)| {
                    Some(([primitive, instance], is_powerful(radiance? * area)?))
                }));
            }
            powers.extend((0..shown.triangles).filter_map(|t| {
                let described = (shown.first_triangle + t) as usize;
                let radiance = all.map_or_else(|| self.own(described), |all| self.radiance(all))?;
                let (corners, _) = shown.in_world(&mesh.triangle(described));
                Some(([t, instance], is_powerful(radiance * area(&corners))?))
            }));
            if powers.len() > MOST_EMITTERS {
                let words = EMITTER_WORDS as u64 * powers.len() as u64;
                return Err(AppearanceError::TooLarge { words });
            }
        }
        Ok(powers)
    }

    fn is_dark(&self) -> bool {
        self.radiance.iter().all(Option::is_none)
    }

    fn radiance(&self, material: u32) -> Option<f64> {
        self.radiance[(material as usize).min(self.radiance.len() - 1)]
    }

    fn own(&self, triangle: usize) -> Option<f64> {
        self.radiance(self.material_of.get(triangle).copied().unwrap_or(0))
    }
}

fn is_powerful(power: f64) -> Option<f64> {
    (power.is_finite() && power > 0.0).then_some(power)
}

fn area(corners: &[[f32; 3]; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| corner.map(f64::from));
    let [x, y] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
    let normal = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    0.5 * normal.iter().map(|part| part * part).sum::<f64>().sqrt()
}
