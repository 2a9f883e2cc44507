//! The fields of a scene file, as `docs/scene-file.md` describes them.

use serde::de::Error;
use serde::{Deserialize, Deserializer};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub(super) format: String,
    pub(super) version: u32,
    #[serde(default = "one")]
    pub(super) frames: u32,
    #[serde(default, deserialize_with = "positive")]
    pub(super) seconds_per_frame: Option<f64>,
    #[serde(default)]
    pub(super) materials: Vec<Material>,
    pub(super) geometries: Vec<Geometry>,
    pub(super) instances: Vec<Instance>,
    #[serde(default)]
    pub(super) cameras: Vec<Camera>,
    #[serde(default)]
    pub(super) lights: Vec<Light>,
    pub(super) environment: Option<Environment>,
}

fn one() -> u32 {
    1
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Material {
    pub(super) name: String,
    #[serde(default, deserialize_with = "parts")]
    pub(super) diffuse: Option<[f32; 3]>,
    #[serde(default, deserialize_with = "parts")]
    pub(super) mirror: Option<[f32; 3]>,
    #[serde(default)]
    pub(super) glass: Option<Glass>,
    #[serde(default, deserialize_with = "roughness")]
    pub(super) roughness: Option<f32>,
    #[serde(default, deserialize_with = "not_negative")]
    pub(super) emission: Option<[f32; 3]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Glass {
    #[serde(deserialize_with = "index")]
    pub(super) index: f32,
    #[serde(default, deserialize_with = "parts")]
    pub(super) tint: Option<[f32; 3]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Geometry {
    pub(super) name: String,
    pub(super) obj: Option<String>,
    pub(super) group: Option<String>,
    pub(super) object: Option<String>,
    #[serde(default, deserialize_with = "points")]
    pub(super) positions: Option<Vec<[f32; 3]>>,
    pub(super) triangles: Option<Vec<[u32; 3]>>,
    pub(super) spheres: Option<Vec<Sphere>>,
    pub(super) capsules: Option<Vec<Capsule>>,
    pub(super) material: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sphere {
    #[serde(deserialize_with = "required")]
    pub(super) centre: [f32; 3],
    #[serde(deserialize_with = "radius")]
    pub(super) radius: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Capsule {
    #[serde(deserialize_with = "required")]
    pub(super) ends: [[f32; 3]; 2],
    #[serde(deserialize_with = "radius")]
    pub(super) radius: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Instance {
    pub(super) geometry: String,
    #[serde(default, deserialize_with = "finite")]
    pub(super) transform: Option<[f32; 12]>,
    #[serde(default, deserialize_with = "finite")]
    pub(super) translate: Option<[f64; 3]>,
    #[serde(default)]
    pub(super) rotate: Option<Rotation>,
    #[serde(default)]
    pub(super) scale: Option<Scale>,
    pub(super) mask: Option<u32>,
    pub(super) id: Option<u32>,
    #[serde(default)]
    pub(super) culling: Culling,
    pub(super) material: Option<String>,
    #[serde(default)]
    pub(super) keys: Vec<Key>,
    pub(super) bake: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Key {
    pub(super) frame: u32,
    #[serde(default, deserialize_with = "finite")]
    pub(super) translate: Option<[f64; 3]>,
    #[serde(default)]
    pub(super) rotate: Option<Rotation>,
    #[serde(default)]
    pub(super) scale: Option<Scale>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rotation {
    #[serde(deserialize_with = "required")]
    pub(super) axis: [f64; 3],
    #[serde(deserialize_with = "required")]
    pub(super) degrees: f64,
}

/// One factor, or one for each axis.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "a scale is a number or three numbers")]
pub(super) enum Scale {
    Even(f64),
    ByAxis([f64; 3]),
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Culling {
    #[default]
    None,
    Back,
    Front,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Camera {
    #[serde(deserialize_with = "required")]
    pub(super) eye: [f32; 3],
    #[serde(deserialize_with = "required")]
    pub(super) at: [f32; 3],
    #[serde(default, deserialize_with = "finite")]
    pub(super) up: Option<[f32; 3]>,
    #[serde(default, deserialize_with = "finite")]
    pub(super) fov_degrees: Option<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "lowercase")]
pub(super) enum Light {
    Point(PointLight),
    Sun(Sun),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PointLight {
    #[serde(deserialize_with = "required")]
    pub(super) position: [f32; 3],
    #[serde(deserialize_with = "colour")]
    pub(super) irradiance: [f32; 3],
    #[serde(deserialize_with = "distance")]
    pub(super) distance: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sun {
    #[serde(deserialize_with = "required")]
    pub(super) towards: [f32; 3],
    #[serde(deserialize_with = "colour")]
    pub(super) irradiance: [f32; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(not(feature = "environment"), allow(dead_code, reason = "it is refused"))]
pub(super) struct Environment {
    pub(super) file: String,
    #[serde(default, deserialize_with = "finite")]
    pub(super) rotation_degrees: Option<f32>,
    #[serde(default, deserialize_with = "strength")]
    pub(super) strength: Option<f32>,
}

/// Numbers that fields consist of.
trait Numbers {
    fn all(&self, is_good: fn(f64) -> bool) -> bool;
}

impl Numbers for f32 {
    fn all(&self, is_good: fn(f64) -> bool) -> bool {
        is_good(f64::from(*self))
    }
}

impl Numbers for f64 {
    fn all(&self, is_good: fn(f64) -> bool) -> bool {
        is_good(*self)
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    fn all(&self, is_good: fn(f64) -> bool) -> bool {
        self.iter().all(|part| part.all(is_good))
    }
}

impl<T: Numbers> Numbers for Vec<T> {
    fn all(&self, is_good: fn(f64) -> bool) -> bool {
        self.iter().all(|part| part.all(is_good))
    }
}

impl<T: Numbers> Numbers for Option<T> {
    fn all(&self, is_good: fn(f64) -> bool) -> bool {
        self.as_ref().is_none_or(|part| part.all(is_good))
    }
}

fn checked<'de, D: Deserializer<'de>, T: Numbers + Deserialize<'de>>(
    from: D,
    is_good: fn(f64) -> bool,
    wanted: &str,
) -> Result<T, D::Error> {
    let value = T::deserialize(from)?;
    if value.all(is_good) { Ok(value) } else { Err(D::Error::custom(wanted)) }
}

fn required<'de, D: Deserializer<'de>, T: Numbers + Deserialize<'de>>(
    from: D,
) -> Result<T, D::Error> {
    checked(from, f64::is_finite, "numbers must be finite")
}

fn finite<'de, D: Deserializer<'de>, T: Numbers + Deserialize<'de>>(
    from: D,
) -> Result<Option<T>, D::Error> {
    required(from).map(Some)
}

fn points<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<[f32; 3]>>, D::Error> {
    required(from).map(Some)
}

fn parts<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f32; 3]>, D::Error> {
    checked(from, |part| (0.0..=1.0).contains(&part), "parts of light are from 0 to 1").map(Some)
}

fn roughness<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f32>, D::Error> {
    checked(from, |x| (0.0..=1.0).contains(&x), "a roughness is from 0 to 1").map(Some)
}

fn strength<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f32>, D::Error> {
    checked(from, |x| (0.0..=1e12).contains(&x), "a strength is from 0 to 1e12").map(Some)
}

fn not_negative<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f32; 3]>, D::Error> {
    colour(from).map(Some)
}

fn colour<'de, D: Deserializer<'de>>(from: D) -> Result<[f32; 3], D::Error> {
    checked(from, |part| part >= 0.0 && part.is_finite(), "light is finite and not negative")
}

fn distance<'de, D: Deserializer<'de>>(from: D) -> Result<f32, D::Error> {
    checked(from, |x| x > 0.0 && x.is_finite(), "a distance is finite and more than 0")
}

fn radius<'de, D: Deserializer<'de>>(from: D) -> Result<f32, D::Error> {
    checked(
        from,
        |x| (1e-37..=f64::from(f32::MAX)).contains(&x),
        "a radius is finite and at least 1e-37",
    )
}

fn index<'de, D: Deserializer<'de>>(from: D) -> Result<f32, D::Error> {
    checked(from, |x| (0.1..=10.0).contains(&x), "refractive indices are from 0.1 to 10")
}

fn positive<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    checked(from, |x| x > 0.0 && x.is_finite(), "a time is finite and more than 0").map(Some)
}
