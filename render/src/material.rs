//! What a surface looks like.

/// How a surface answers light: it scatters a part evenly (Lambert), mirrors a part, or is the
/// boundary of a clear dielectric such as glass or water.
///
/// Colours are linear red, green and blue.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the file, or a name of ours.
    pub name: String,
    /// Part of the light that is scattered back, 0 to 1 per channel. Multiplied by the texture
    /// where there is one.
    pub diffuse: [f32; 3],
    /// Part of the light that is mirrored, 0 to 1 per channel; black for a surface that is no
    /// mirror.
    pub mirror: [f32; 3],
    /// What lies behind the surface when it is the boundary of a clear body. Such a surface
    /// reflects and refracts by Fresnel's equations; `diffuse` and `mirror` are not used.
    pub dielectric: Option<Dielectric>,
    /// How rough a mirror or a clear body is, 0 to 1: slopes are distributed by GGX with the width `roughness^2`. With 0 it is
    /// perfectly smooth, and so it is in pictures of direct light, whatever this says.
    pub roughness: f32,
    /// Radiance that the surface sends out on both of its sides; black for one that does not shine.
    pub emission: [f32; 3],
    /// The texture that `diffuse` is multiplied by, as an index of the scene's textures.
    pub texture: Option<u32>,
}

/// A clear body, seen from its surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Refractive index inside over the index outside, more than 0. Inside is where the corners of
    /// the triangles run clockwise. With 1 light goes straight through.
    pub refractive_index: f32,
    /// Part of the light that the surface transmits, 0 to 1 per channel, apart from what Fresnel's
    /// equations reflect.
    pub tint: [f32; 3],
}

impl Dielectric {
    /// Range of refractive indices; those of a file are clamped to it.
    pub const INDEX_RANGE: std::ops::RangeInclusive<f32> = 0.1..=10.0;
}

impl Material {
    /// Warm grey clay: the material of triangles without one.
    pub fn clay() -> Material {
        Material::new("clay", [0.62, 0.55, 0.47])
    }

    /// A diffuse material by name and linear colour. Parts outside 0 to 1 are clamped, NaN becomes 0.
    pub fn new(name: impl Into<String>, diffuse: [f32; 3]) -> Material {
        Material {
            name: name.into(),
            diffuse: fractions(diffuse),
            mirror: [0.0; 3],
            dielectric: None,
            roughness: 0.0,
            emission: [0.0; 3],
            texture: None,
        }
    }

    /// The same material with a mirror coat. Each channel of `diffuse` is lowered where the two
    /// together would send back more light than comes in.
    #[must_use]
    pub fn with_mirror(mut self, mirror: [f32; 3]) -> Material {
        self.mirror = fractions(mirror);
        for (diffuse, mirror) in self.diffuse.iter_mut().zip(self.mirror) {
            *diffuse = diffuse.min(1.0 - mirror);
        }
        self
    }

    /// The same material as the boundary of a clear body. The index is clamped to
    /// [`Dielectric::INDEX_RANGE`], NaN becomes 1; tints as for [`Material::new`].
    #[must_use]
    pub fn with_dielectric(mut self, refractive_index: f32, tint: [f32; 3]) -> Material {
        let (least, most) = (*Dielectric::INDEX_RANGE.start(), *Dielectric::INDEX_RANGE.end());
        let refractive_index =
            if refractive_index.is_nan() { 1.0 } else { refractive_index.clamp(least, most) };
        self.dielectric = Some(Dielectric { refractive_index, tint: fractions(tint) });
        self
    }

    /// The same material with a rough mirror or as a rough clear body. Numbers outside 0 to 1 are clamped, NaN becomes 0.
    #[must_use]
    pub fn with_roughness(mut self, roughness: f32) -> Material {
        [self.roughness, ..] = fractions([roughness; 3]);
        self
    }

    /// The same material as a source of light. Negative radiance and NaN become 0, infinity the
    /// greatest radiance that is kept, 2^40.
    #[must_use]
    pub fn with_emission(mut self, radiance: [f32; 3]) -> Material {
        self.emission = radiance.map(|part| if part > 0.0 { part.min(1.1e12) } else { 0.0 });
        self
    }

    /// Whether it sends out light.
    pub fn shines(&self) -> bool {
        self.emission.iter().any(|part| *part > 0.0)
    }

    /// Whether it is a mirror; reflection by a dielectric does not count.
    pub fn is_mirror(&self) -> bool {
        self.dielectric.is_none() && self.mirror.iter().any(|part| *part > 0.0)
    }

    /// Whether it scatters light evenly, so that lights are worth sampling.
    pub fn is_diffuse(&self) -> bool {
        self.dielectric.is_none() && self.diffuse.iter().any(|part| *part > 0.0)
    }
}

fn fractions(colour: [f32; 3]) -> [f32; 3] {
    colour.map(|part| if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_clamped() {
        assert_eq!(Material::new("x", [f32::NAN, 2.0, -1.0]).diffuse, [0.0, 1.0, 0.0]);
        let glass = Material::clay().with_dielectric(f32::NAN, [1.0; 3]).dielectric.unwrap();
        assert_eq!(glass.refractive_index, 1.0);
        assert_eq!(Material::clay().with_emission([-1.0, f32::NAN, 3.0]).emission, [0.0, 0.0, 3.0]);
    }

    #[test]
    fn no_more_light_goes_out_than_comes_in() {
        let coated = Material::new("x", [0.8, 0.2, 0.5]).with_mirror([0.5, 0.5, 0.5]);
        assert_eq!(coated.diffuse, [0.5, 0.2, 0.5]);
    }
}
