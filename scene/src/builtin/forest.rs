//! A forest: a few trees and rocks, each of them many times, on hills around a lake.

use super::BuiltinError;
use super::hills::{Hills, Kinds, Objects, ground};
use crate::Light;
use crate::instanced::InstancedScene;

const DEFAULT: u64 = 4_000;

/// Late light from the side.
pub(super) const SUN: Light =
    Light::Directional { towards: [-0.62, 0.48, 0.36], irradiance: [3.6, 3.0, 2.2] };

pub(super) fn open(size: Option<&str>) -> Result<InstancedScene, BuiltinError> {
    let count = super::size("forest", size, DEFAULT, [10, 1_000_000])?;
    let hills = Hills { side: 2.6 * (count as f64).sqrt().max(16.0) };
    let mut objects = Objects::new("forest");
    ground(&mut objects, hills);
    let kinds = Kinds::new(&mut objects);
    let eye = look(&mut objects, hills);
    kinds.scatter(&mut objects, hills, count, eye);
    Ok(objects.finish(1, 1.0 / 24.0))
}

/// From the shore of the lake over the water.
pub(super) fn look(objects: &mut Objects, hills: Hills) -> [f64; 3] {
    let away = (0.33 * hills.side).min(75.0);
    let (x, z) = (0.25 * away, away);
    let eye = [x, hills.height(x, z).max(0.5) + 11.0, z];
    let at = [-0.1 * away, 1.0, -0.35 * away];
    objects.builder.look(eye.map(|x| x as f32), at.map(|x| x as f32), 48.0);
    objects.builder.shine(SUN);
    eye
}
