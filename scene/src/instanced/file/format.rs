//! The fields of a scene file, as `docs/scene-file.md` describes them.

use super::counted::{Counted, FieldName, full, object, plain};
use crate::budget::Budget;
use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use std::borrow::Cow;
use std::fmt;

/// A name or a path, as the text has it where that is possible. The text stays while its file is there.
type Text<'t> = Cow<'t, str>;

object! {
    /// A file.
    File['t] of 't {
        format: Text<'t> = Counted::read;
        version: u32 = plain;
        frames: u32 = plain, or 1;
        seconds_per_frame: Option<f64> = positive, or None;
        materials: Vec<Material<'t>> = Counted::read, or Vec::new();
        geometries: Vec<Geometry<'t>> = Counted::read;
        instances: Vec<Instance<'t>> = Counted::read;
        cameras: Vec<Camera> = Counted::read, or Vec::new();
        lights: Vec<Light> = Counted::read, or Vec::new();
        environment: Option<Environment<'t>> = Counted::read, else None;
    }
}

object! {
    /// A material.
    Material['t] of 't {
        name: Text<'t> = Counted::read;
        diffuse: Option<[f32; 3]> = parts, or None;
        mirror: Option<[f32; 3]> = parts, or None;
        glass: Option<Box<Glass>> = Counted::read, or None;
        roughness: Option<f32> = up_to_one, or None;
        emission: Option<[f32; 3]> = not_negative, or None;
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Glass {
    #[serde(deserialize_with = "index")]
    pub(super) index: f32,
    #[serde(default, deserialize_with = "light")]
    pub(super) tint: Option<[f32; 3]>,
}

object! {
    /// A geometry.
    Geometry['t] of 't {
        name: Text<'t> = Counted::read;
        obj: Option<Text<'t>> = Counted::read, else None;
        group: Option<Text<'t>> = Counted::read, else None;
        object: Option<Text<'t>> = Counted::read, else None;
        positions: Option<Vec<[f32; 3]>> = points, or None;
        triangles: Option<Vec<[u32; 3]>> = Counted::read, else None;
        spheres: Option<Vec<Sphere>> = Counted::read, else None;
        capsules: Option<Vec<Capsule>> = Counted::read, else None;
        material: Option<Text<'t>> = Counted::read, else None;
    }
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

object! {
    /// An instance.
    Instance['t] of 't {
        geometry: Text<'t> = Counted::read;
        transform: Option<Box<[f32; 12]>> = matrix, or None;
        translate: Option<[f64; 3]> = finite, or None;
        rotate: Option<Box<Rotation>> = Counted::read, or None;
        scale: Option<Scale> = Counted::read, or None;
        mask: Option<u32> = plain, else None;
        id: Option<u32> = plain, else None;
        culling: Culling = plain, or Culling::None;
        material: Option<Text<'t>> = Counted::read, else None;
        keys: Vec<Key> = Counted::read, or Vec::new();
        bake: Option<Text<'t>> = Counted::read, else None;
    }
}

object! {
    /// A pose in a frame.
    Key of 't {
        frame: u32 = plain;
        translate: Option<[f64; 3]> = finite, or None;
        rotate: Option<Box<Rotation>> = Counted::read, or None;
        scale: Option<Scale> = Counted::read, or None;
    }
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
pub(super) enum Scale {
    Even(f64),
    ByAxis(Box<[f64; 3]>),
}

/// Read here, since what reads an enum without tags keeps all values of a list before it looks at them.
impl<'de> Counted<'de> for Scale {
    fn read<D: Deserializer<'de>>(from: D, budget: &Budget) -> Result<Self, D::Error> {
        const WANTED: &str = "a scale is a number or three numbers";
        struct Factors<'b>(&'b Budget);
        impl<'de> Visitor<'de> for Factors<'_> {
            type Value = Scale;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or three numbers")
            }

            fn visit_f64<E: Error>(self, factor: f64) -> Result<Scale, E> {
                Ok(Scale::Even(factor))
            }

            fn visit_u64<E: Error>(self, factor: u64) -> Result<Scale, E> {
                Ok(Scale::Even(factor as f64))
            }

            fn visit_i64<E: Error>(self, factor: i64) -> Result<Scale, E> {
                Ok(Scale::Even(factor as f64))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut factors: A) -> Result<Scale, A::Error> {
                let mut all = [0.0; 3];
                for factor in &mut all {
                    *factor = factors.next_element()?.ok_or_else(|| A::Error::custom(WANTED))?;
                }
                if factors.next_element::<f64>()?.is_some() {
                    return Err(A::Error::custom(WANTED));
                }
                self.0.take(size_of_val(&all) as u64).map_err(full)?;
                Ok(Scale::ByAxis(Box::new(all)))
            }
        }
        from.deserialize_any(Factors(budget))
    }
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
    #[serde(default, deserialize_with = "unless_left_out")]
    pub(super) up: Option<[f32; 3]>,
    #[serde(default, deserialize_with = "unless_left_out")]
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

object! {
    /// An environment map.
    #[cfg_attr(not(feature = "environment"), allow(dead_code, reason = "it is refused"))]
    Environment['t] of 't {
        file: Text<'t> = Counted::read;
        rotation_degrees: Option<f32> = finite, or None;
        strength: Option<f32> = factor, or None;
    }
}

/// Entries of lists that take nothing beside their own bytes.
macro_rules! entries {
    ($($type:ty),*) => {
        $(impl<'de> Counted<'de> for $type {
            fn read<D: Deserializer<'de>>(from: D, budget: &Budget) -> Result<Self, D::Error> {
                plain(from, budget)
            }
        })*
    };
}
entries!([u32; 3], Sphere, Capsule, Camera, Light);

/// A point.
impl<'de> Counted<'de> for [f32; 3] {
    fn read<D: Deserializer<'de>>(from: D, _: &Budget) -> Result<Self, D::Error> {
        required(from)
    }
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

/// As [`required`], for fields of what is read without a budget.
fn unless_left_out<'de, D: Deserializer<'de>, T: Numbers + Deserialize<'de>>(
    from: D,
) -> Result<Option<T>, D::Error> {
    required(from).map(Some)
}

fn finite<'de, D: Deserializer<'de>, T: Numbers + Deserialize<'de>>(
    from: D,
    _: &Budget,
) -> Result<Option<T>, D::Error> {
    required(from).map(Some)
}

fn matrix<'de, D: Deserializer<'de>>(
    from: D,
    budget: &Budget,
) -> Result<Option<Box<[f32; 12]>>, D::Error> {
    budget.take(size_of::<[f32; 12]>() as u64).map_err(full)?;
    required(from).map(|all| Some(Box::new(all)))
}

fn points<'de, D: Deserializer<'de>>(
    from: D,
    budget: &Budget,
) -> Result<Option<Vec<[f32; 3]>>, D::Error> {
    Counted::read(from, budget).map(Some)
}

fn light<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f32; 3]>, D::Error> {
    checked(from, |part| (0.0..=1.0).contains(&part), "parts of light are from 0 to 1").map(Some)
}

fn parts<'de, D: Deserializer<'de>>(from: D, _: &Budget) -> Result<Option<[f32; 3]>, D::Error> {
    light(from)
}

fn up_to_one<'de, D: Deserializer<'de>>(from: D, _: &Budget) -> Result<Option<f32>, D::Error> {
    checked(from, |x| (0.0..=1.0).contains(&x), "a roughness is from 0 to 1").map(Some)
}

fn factor<'de, D: Deserializer<'de>>(from: D, _: &Budget) -> Result<Option<f32>, D::Error> {
    checked(from, |x| (0.0..=1e12).contains(&x), "a strength is from 0 to 1e12").map(Some)
}

fn not_negative<'de, D: Deserializer<'de>>(
    from: D,
    _: &Budget,
) -> Result<Option<[f32; 3]>, D::Error> {
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

fn positive<'de, D: Deserializer<'de>>(from: D, _: &Budget) -> Result<Option<f64>, D::Error> {
    checked(from, |x| x > 0.0 && x.is_finite(), "a time is finite and more than 0").map(Some)
}
