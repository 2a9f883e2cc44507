//! What a surface looks like.

/// A surface that scatters light evenly (Lambert).
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the file, or a name of ours.
    pub name: String,
    /// Part of the light that is scattered back, linear red, green and blue, each 0 to 1; `Kd` of
    /// an .mtl file, or half of `Ks` where `Kd` is black.
    pub diffuse: [f32; 3],
}

impl Material {
    /// Warm grey clay: what triangles without a material are made of.
    pub fn clay() -> Material {
        Material::new("clay", [0.62, 0.55, 0.47])
    }

    /// A material by name and linear colour. Parts outside 0 to 1 are clamped, NaN becomes 0.
    pub fn new(name: impl Into<String>, diffuse: [f32; 3]) -> Material {
        let part = |part: f32| if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) };
        Material { name: name.into(), diffuse: diffuse.map(part) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_clamped() {
        assert_eq!(Material::new("x", [f32::NAN, 2.0, -1.0]).diffuse, [0.0, 1.0, 0.0]);
    }
}
