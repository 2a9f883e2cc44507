//! From what an .mtl file says to a material, by the rule stated at [`MaterialRule`].

use super::mtl::Entry;
use crate::{Material, MaterialRule};

/// From this reflectance on, `Ks` is a mirror under [`MaterialRule::Specular`]; what does not conduct
/// reflects less than that face on.
const LEAST_SPECULAR: f32 = 0.05;

/// Why a material was not read as written, for a note.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Odd {
    /// `illum` asks for refraction, and nothing else does.
    RefractsNothing,
    /// Partly clear, but more of it opaque.
    MoreOpaque,
    /// `d` and `Tr` do not fit together.
    Disagrees,
}

impl Odd {
    pub(super) const ALL: [Odd; 3] = [Odd::RefractsNothing, Odd::MoreOpaque, Odd::Disagrees];

    /// What is said of some materials.
    pub(super) const fn sentence(self) -> &'static str {
        match self {
            Odd::RefractsNothing => "ask for refraction by `illum` only and are drawn opaque",
            Odd::MoreOpaque => "are more opaque than clear and are drawn opaque",
            Odd::Disagrees => "have a `d` and a `Tr` that do not add up to 1; `d` counts",
        }
    }
}

/// The material of an entry; `None` when the entry does not say what it looks like. Its texture is
/// left to the caller: `textured` says whether there is one.
pub(super) fn material(
    entry: &Entry,
    rule: MaterialRule,
    textured: bool,
) -> (Option<Material>, Vec<Odd>) {
    let mut odd = Vec::new();
    let white = [1.0f32; 3];
    let black = [0.0f32; 3];
    let lit = |colour: Option<[f32; 3]>| colour.filter(|c| c.iter().any(|part| *part > 0.0));
    let (specular, emission) = (lit(entry.specular), lit(entry.emission));
    let filter = entry.filter.unwrap_or(white);
    let index = entry.refractive_index.unwrap_or(1.0);
    let opaque = opaque_part(entry, &mut odd);
    let by_illum = matches!(entry.illum, Some(4 | 6 | 7 | 9));
    let refracts = by_illum && (index != 1.0 || filter != white || opaque < 1.0);
    if by_illum && !refracts {
        odd.push(Odd::RefractsNothing);
    }
    let clear = refracts || opaque <= 0.5;
    if !clear && opaque < 1.0 {
        odd.push(Odd::MoreOpaque);
    }
    let says_something =
        entry.diffuse.is_some() || textured || clear || specular.is_some() || emission.is_some();
    if !says_something {
        return (None, odd);
    }
    let diffuse = match lit(entry.diffuse) {
        Some(colour) => colour,
        None if textured => white,
        None => black,
    };
    let made = Material::new(entry.name.as_str(), diffuse).with_emission(emission.unwrap_or(black));
    let rough = |made: Material| made.with_roughness(roughness(entry));
    if clear {
        let tint = match refracts {
            true => filter,
            false => [0, 1, 2].map(|k| (1.0 - opaque) * filter[k] + opaque * made.diffuse[k]),
        };
        return (Some(rough(made.with_dielectric(index, tint))), odd);
    }
    let mirror = match rule {
        MaterialRule::Specular => specular.filter(|c| c.iter().any(|part| *part > LEAST_SPECULAR)),
        MaterialRule::Illum if matches!(entry.illum, Some(3 | 5 | 8)) => specular,
        MaterialRule::Illum => None,
    };
    let all_in_specular = || specular.filter(|_| diffuse == black);
    match mirror.or_else(all_in_specular) {
        Some(mirror) => (Some(rough(made.with_mirror(mirror))), odd),
        None => (Some(made), odd),
    }
}

/// How rough a mirror or clear body is. What `illum` has traced as mirrors or glass is smooth, and its `Ns` is of highlights alone.
fn roughness(entry: &Entry) -> f32 {
    let traced = matches!(entry.illum, Some(3..=9));
    let exponent = entry.exponent.filter(|_| !traced);
    // Walter et al. 2007: the width of slopes that gives about the highlight of Phong's exponent.
    let by_exponent = exponent.map(|n| (2.0 / (n.max(0.0) + 2.0)).sqrt().sqrt());
    entry.roughness.or(by_exponent).unwrap_or(0.0)
}

/// The part of the light that does not get through, 0 to 1.
fn opaque_part(entry: &Entry, odd: &mut Vec<Odd>) -> f32 {
    let by_transparency = entry.transparency.map(|part| 1.0 - part);
    if let (Some(d), Some(other)) = (entry.dissolve, by_transparency)
        && (d - other).abs() > 0.01
    {
        odd.push(Odd::Disagrees);
    }
    entry.dissolve.or(by_transparency).unwrap_or(1.0).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roughness_is_that_of_pr_or_else_of_ns() {
        let metal = Entry { specular: Some([0.9; 3]), ..Entry::default() };
        let glass = Entry { dissolve: Some(0.0), ..Entry::default() };
        let rough = |entry: &Entry| {
            let (made, odd) = material(entry, MaterialRule::Illum, false);
            assert!(odd.is_empty());
            made.unwrap().roughness
        };
        for entry in [metal, glass] {
            let with = |roughness, exponent, illum| {
                rough(&Entry { roughness, exponent, illum, ..entry.clone() })
            };
            assert_eq!(with(None, None, None), 0.0);
            assert_eq!(with(Some(0.3), Some(10.0), Some(2)), 0.3);
            assert_eq!(with(Some(3.0), None, Some(3)), 1.0);
            assert_eq!(with(None, Some(0.0), None), 1.0);
            assert_eq!(with(None, Some(-5.0), None), 1.0);
            assert_eq!(with(None, Some(30.0), Some(2)), 0.5);
            assert!(with(None, Some(f32::MAX), None) < 1e-9);
        }
        let traced = Entry {
            diffuse: Some([0.5; 3]),
            specular: Some([0.5; 3]),
            illum: Some(3),
            exponent: Some(30.0),
            ..Entry::default()
        };
        assert_eq!(rough(&traced), 0.0);
        assert_eq!(rough(&Entry { roughness: Some(0.2), ..traced.clone() }), 0.2);
        // What is neither mirror nor clear is not rough.
        assert_eq!(rough(&Entry { illum: Some(2), roughness: Some(0.2), ..traced }), 0.0);
    }
}
