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
    if clear {
        let tint = match refracts {
            true => filter,
            false => [0, 1, 2].map(|k| (1.0 - opaque) * filter[k] + opaque * made.diffuse[k]),
        };
        return (Some(made.with_dielectric(index, tint)), odd);
    }
    let mirror = match rule {
        MaterialRule::Specular => specular.filter(|c| c.iter().any(|part| *part > LEAST_SPECULAR)),
        MaterialRule::Illum if matches!(entry.illum, Some(3 | 5 | 8)) => specular,
        MaterialRule::Illum => None,
    };
    let all_in_specular = || specular.filter(|_| diffuse == black);
    match mirror.or_else(all_in_specular) {
        Some(mirror) => (Some(made.with_mirror(mirror)), odd),
        None => (Some(made), odd),
    }
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
