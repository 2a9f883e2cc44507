//! A scene's appearance as words, the form that every executor reads: materials, lights, triangles
//! that shine, textures, and the data of every triangle. Sections that a scene does not need are
//! empty.
//!
//! | section | words an element | what they are |
//! |---|---:|---|
//! | materials | 16 | kind, texture or [`NONE`], refractive index, 1 when it scatters evenly; diffuse; mirror or tint; emission, each with one more word: the second has the width of GGX, the others are not used |
//! | lights | 8 | kind; position or direction; irradiance; its distance |
//! | emitters | 4 | triangle; probability of this one and all before, as a part of 2^32; its own probability; its instance, 0 in one mesh |
//! | textures | 4 | first texel from the start of the texels; width; height; not used |
//! | sRGB | 512 | linear value of each byte; then the least linear value that is shown as each byte |
//! | material of | 1 | a triangle's material |
//! | normals | 9 | at a triangle's corners; zero for none |
//! | texture coordinates | 6 | at a triangle's corners |
//! | texels | 1 | red in the low byte, green, blue, alpha |

mod appearance;
pub mod instances;
mod needs;
mod round;
mod shining;
mod srgb;

pub use appearance::{Appearance, AppearanceError};
pub use needs::Needs;

use crate::environment_map::EnvironmentMap;
use crate::layout::Frame;
use crate::light::Light;
use crate::material::Material;
use crate::vector::normalized;
use core::ops::Range;
use core::sync::atomic::{AtomicU64, Ordering};
use instances::{Changed, InstanceTable};
pub(crate) use round::RoundPlace;
use shining::Shining;
use splitplane_core::mesh::Mesh;
use srgb::{least_shown, linear};
use std::sync::Arc;

/// In place of an index: nothing.
pub const NONE: u32 = u32::MAX;

/// Words of a material.
pub const MATERIAL_WORDS: u32 = 16;
/// Words of a light.
pub const LIGHT_WORDS: u32 = 8;
/// Words of a triangle that shines.
pub const EMITTER_WORDS: u32 = 4;
/// Words of a texture.
pub const TEXTURE_WORDS: u32 = 4;

/// Kind of a material that scatters, mirrors or both.
pub const OPAQUE: u32 = 0;
/// Kind of the surface of a clear body.
pub const DIELECTRIC: u32 = 1;
/// Kind of a light at a point.
pub const POINT: u32 = 0;
/// Kind of a light that is far away.
pub const DIRECTIONAL: u32 = 1;

/// Where the sections start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sections {
    lights: u32,
    emitters: u32,
    textures: u32,
    srgb: u32,
    material_of: u32,
    normals: u32,
    texcoords: u32,
    texels: u32,
}

/// A scene's appearance, ready for executors.
#[derive(Clone, Debug, Default)]
pub struct SceneData {
    words: Vec<u32>,
    sections: Sections,
    needs: Needs,
    environment: Option<Arc<EnvironmentMap>>,
    materials: u32,
    triangles: u32,
    revision: u64,
    normals_revision: u64,
    /// By material the radiance that the list of emitters was made with.
    radiance: Vec<Option<f64>>,
}

/// A number that no earlier call has returned.
fn next_revision() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    LAST.fetch_add(1, Ordering::Relaxed) + 1
}

/// Whether the surface of a material takes its colour from a texture that is there.
fn is_textured(material: &Material, appearance: &Appearance<'_>) -> bool {
    let exists = |texture| (texture as usize) < appearance.textures.len();
    material.dielectric.is_none() && material.texture.is_some_and(exists)
}

/// Which lists by corner an appearance needs.
struct Corners {
    textures: bool,
    smooth: bool,
}

impl Corners {
    fn of(appearance: &Appearance<'_>) -> Corners {
        let textured = appearance.materials.iter().any(|m| is_textured(m, appearance));
        Corners {
            textures: textured && !appearance.texcoord_indices.is_empty(),
            smooth: !appearance.normal_indices.is_empty() && !appearance.normals.is_empty(),
        }
    }
}

impl SceneData {
    /// Describes the appearance of the triangles of `mesh`.
    ///
    /// # Errors
    /// More than can be addressed.
    pub fn new(mesh: &Mesh<'_>, appearance: &Appearance<'_>) -> Result<SceneData, AppearanceError> {
        let mut data = SceneData::default();
        data.describe_again(mesh, appearance)?;
        Ok(data)
    }

    /// Whether the appearance can be addressed; nothing else can fail.
    ///
    /// # Errors
    /// As for [`SceneData::new`].
    pub(crate) fn check(
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
    ) -> Result<(), AppearanceError> {
        let Corners { textures, smooth } = Corners::of(appearance);
        let texels: u64 = appearance.textures.iter().map(|t| t.texels().len() as u64).sum();
        let per_triangle = 1 + if smooth { 9 } else { 0 } + if textures { 6 } else { 0 };
        let words = per_triangle * mesh.len() as u64
            + 20 * appearance.materials.len().max(1) as u64
            + if textures { texels } else { 0 };
        // Emitters and lights are far fewer than what is left.
        if words > u64::from(u32::MAX) / 2 {
            return Err(AppearanceError::TooLarge { words });
        }
        Ok(())
    }

    /// As [`SceneData::new`], into the memory of the previous description.
    ///
    /// # Errors
    /// As for [`SceneData::new`]; the previous description is kept.
    pub fn describe_again(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
    ) -> Result<(), AppearanceError> {
        self.describe(mesh, appearance, None)
    }

    /// Describes the appearance of instances: `mesh` has the triangles of all geometries, one after the other.
    ///
    /// # Errors
    /// As for [`SceneData::new`]; the previous description is kept.
    pub fn describe_instances(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        instances: &InstanceTable,
    ) -> Result<(), AppearanceError> {
        self.describe(mesh, appearance, Some(instances))
    }

    /// Finds again which triangles of instances shine, for an appearance that is otherwise what it was. Their list is written over where it is as long as it
    /// was; else, and where there are other triangles or materials, all is described anew.
    ///
    /// # Errors
    /// As for [`SceneData::new`]; the previous description is kept.
    pub fn update_emitters(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        instances: &InstanceTable,
    ) -> Result<(), AppearanceError> {
        let clay = [Material::clay()];
        let materials = materials_of(appearance, &clay);
        if self.has_other_lists(mesh, materials) {
            return self.describe(mesh, appearance, Some(instances));
        }
        let mut sources = Shining::new(materials, appearance.material_of);
        let shining = sources.of_instances(mesh, instances)?;
        let all = core::mem::take(&mut self.words);
        self.emitters(&shining);
        let own = core::mem::replace(&mut self.words, all);
        let Sections { emitters, textures, .. } = self.sections;
        let there = &mut self.words[emitters as usize..textures as usize];
        if own.len() != there.len() {
            return self.describe(mesh, appearance, Some(instances));
        }
        if own != *there {
            there.copy_from_slice(&own);
            self.revision = next_revision();
        }
        self.radiance = sources.into_radiance();
        Ok(())
    }

    /// Whether what shines of changed instances, as the table has them now, is part of the list of emitters or belongs there: to be asked before the
    /// table is written and after. Also where the list cannot be relied on: other materials, other triangles, or anything may have changed.
    pub(crate) fn needs_emitters_of(
        &self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        instances: &InstanceTable,
        changed: &Changed,
    ) -> bool {
        let clay = [Material::clay()];
        let materials = materials_of(appearance, &clay);
        let Changed::These { rows, replaced } = changed else { return true };
        let mut sources = Shining::new(materials, appearance.material_of);
        self.has_other_lists(mesh, materials)
            || !sources.has_radiance(&self.radiance)
            || rows
                .iter()
                .chain(replaced)
                .filter_map(|name| instances.shown(*name))
                .any(|own| sources.has(own))
    }

    /// Whether other triangles or materials are there than those described, by their numbers.
    fn has_other_lists(&self, mesh: &Mesh<'_>, materials: &[Material]) -> bool {
        mesh.len() as u32 != self.triangles || materials.len() as u32 != self.materials
    }

    fn describe(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        instances: Option<&InstanceTable>,
    ) -> Result<(), AppearanceError> {
        SceneData::check(mesh, appearance)?;
        let Corners { textures, smooth } = Corners::of(appearance);
        let clay = [Material::clay()];
        let materials = materials_of(appearance, &clay);
        let mut sources = Shining::new(materials, appearance.material_of);
        let shining = match instances {
            None => sources.of_mesh(mesh),
            Some(table) => sources.of_instances(mesh, table)?,
        };
        self.radiance = sources.into_radiance();
        self.words.clear();
        self.revision = next_revision();
        self.triangles = mesh.len() as u32;
        self.materials = materials.len() as u32;
        for material in materials {
            self.material(material, textures && is_textured(material, appearance));
        }
        self.sections.lights = self.here();
        for light in appearance.lights {
            self.light(light);
        }
        self.sections.emitters = self.here();
        self.emitters(&shining);
        let emitters = (self.here() - self.sections.emitters) / EMITTER_WORDS;
        self.sections.textures = self.here();
        if textures {
            let mut first = 0;
            for texture in appearance.textures {
                self.words.extend([first, texture.width(), texture.height(), 0]);
                first += texture.texels().len() as u32;
            }
        }
        self.sections.srgb = self.here();
        self.words.extend((0..256).map(|byte| linear(f64::from(byte) / 255.0).to_bits()));
        self.words.extend((0..256).map(|byte| least_shown(byte).to_bits()));
        self.sections.material_of = self.here();
        let last = self.materials - 1;
        let material_of = |t: usize| appearance.material_of.get(t).copied().unwrap_or(0).min(last);
        self.words.extend((0..mesh.len()).map(material_of));
        self.sections.normals = self.here();
        if smooth {
            self.words.extend(normal_words(mesh, appearance));
        }
        self.sections.texcoords = self.here();
        if textures {
            let coordinate =
                |i: u32| appearance.texcoords.get(i as usize).copied().unwrap_or_default();
            self.words.extend((0..mesh.len()).flat_map(|t| {
                let corners = appearance.texcoord_indices.get(t).copied().unwrap_or([NONE; 3]);
                corners
                    .into_iter()
                    .flat_map(coordinate)
                    .map(|part| if part.is_finite() { part.to_bits() } else { 0 })
            }));
        }
        self.sections.texels = self.here();
        if textures {
            let texels = appearance.textures.iter().flat_map(|texture| texture.texels());
            self.words.extend(texels.map(|texel| u32::from_le_bytes(*texel)));
        }
        let used = |test: fn(&Material) -> bool| materials.iter().any(test);
        self.needs = Needs {
            diffuse: used(Material::is_diffuse),
            mirrors: used(Material::is_mirror),
            dielectrics: used(|m| m.dielectric.is_some()),
            rough: used(|m| m.roughness > 0.0 && (m.is_mirror() || m.dielectric.is_some())),
            textures,
            smooth_normals: smooth,
            lights: appearance.lights.len() as u32,
            emitters,
            environment_map: appearance.environment.is_some_and(|map| map.shines()),
        };
        self.environment = appearance.environment.cloned();
        Ok(())
    }

    /// Takes over new normals for a mesh whose triangles have moved. Nothing happens when the scene
    /// was described without any.
    pub fn update_normals(&mut self, mesh: &Mesh<'_>, appearance: &Appearance<'_>) {
        if self.needs.smooth_normals && mesh.len() as u32 == self.triangles {
            let first = self.sections.normals as usize;
            let last = first + 9 * mesh.len();
            self.normals_revision = next_revision();
            for (word, new) in
                self.words[first..last].iter_mut().zip(normal_words(mesh, appearance))
            {
                *word = new;
            }
        }
    }

    /// The words.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Changes with every description. Executors that keep the words elsewhere send them again when
    /// it does. Equal numbers mean equal words, except for normals.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Changes with every [`SceneData::update_normals`].
    pub fn normals_revision(&self) -> u64 {
        self.normals_revision
    }

    /// Where the normals are among the words.
    pub fn normal_words(&self) -> Range<usize> {
        self.sections.normals as usize..self.sections.texcoords as usize
    }

    /// Triangles described.
    pub fn triangles(&self) -> u32 {
        self.triangles
    }

    /// Light from everywhere, where it is a map.
    pub fn environment(&self) -> Option<&EnvironmentMap> {
        self.environment.as_deref()
    }

    /// What the scene needs.
    pub fn needs(&self) -> Needs {
        self.needs
    }

    /// Whether the surface of a triangle is that of a clear body.
    pub fn is_clear(&self, triangle: u32) -> bool {
        let material = self.words[(self.sections.material_of + triangle) as usize];
        self.words[(MATERIAL_WORDS * material) as usize] == DIELECTRIC
    }

    /// Where the sections are, for kernels.
    pub(crate) fn describe_to(&self, frame: &mut Frame) {
        let sections = &self.sections;
        frame.lights = self.needs.lights;
        frame.emitters = self.needs.emitters;
        frame.materials = self.materials;
        frame.triangles = self.triangles;
        frame.lights_at = sections.lights;
        frame.emitters_at = sections.emitters;
        frame.textures_at = sections.textures;
        frame.srgb_at = sections.srgb;
        frame.material_of_at = sections.material_of;
        frame.normals_at = sections.normals;
        frame.texcoords_at = sections.texcoords;
        frame.texels_at = sections.texels;
    }

    fn here(&self) -> u32 {
        self.words.len() as u32
    }

    fn floats(&mut self, numbers: impl IntoIterator<Item = f32>) {
        self.words.extend(numbers.into_iter().map(f32::to_bits));
    }

    fn material(&mut self, material: &Material, textured: bool) {
        let texture = if textured { material.texture.unwrap_or(NONE) } else { NONE };
        let (kind, index, second) = match material.dielectric {
            Some(clear) => (DIELECTRIC, clear.refractive_index, clear.tint),
            None => (OPAQUE, 1.0, material.mirror),
        };
        let diffuse = if kind == OPAQUE { material.diffuse } else { [0.0; 3] };
        self.words.extend([kind, texture, index.to_bits(), u32::from(material.is_diffuse())]);
        let alpha = material.roughness * material.roughness;
        for (colour, more) in [(diffuse, 0.0), (second, alpha), (material.emission, 0.0)] {
            self.floats(colour);
            self.floats([more]);
        }
    }

    fn light(&mut self, light: &Light) {
        let (kind, place, irradiance, distance) = match *light {
            Light::Point { position, irradiance, distance } => {
                (POINT, position, irradiance, distance)
            }
            Light::Directional { towards, irradiance } => {
                (DIRECTIONAL, normalized(towards), irradiance, 1.0)
            }
        };
        self.words.push(kind);
        self.floats(place);
        self.floats(irradiance);
        self.floats([distance]);
    }

    /// The triangles that shine, each with a probability in proportion to its power. They are
    /// chosen by a word of 32 random bits, so a triangle too dim for one word of 2^32 is left out.
    fn emitters(&mut self, powers: &[([u32; 2], f64)]) {
        let total: f64 = powers.iter().map(|(_, power)| power).sum();
        let (mut sum, mut before) = (0.0, 0u64);
        for (place, ([triangle, instance], power)) in powers.iter().enumerate() {
            sum += power;
            let last = place + 1 == powers.len();
            let until = if last { 1 << 32 } else { (sum / total * 4_294_967_296.0) as u64 };
            if until > before {
                let probability = (until - before) as f64 / 4_294_967_296.0;
                let greatest_word = (until - 1) as u32;
                let probability = (probability as f32).to_bits();
                self.words.extend([*triangle, greatest_word, probability, *instance]);
                before = until;
            }
        }
    }
}

/// The materials; one of clay where there are none.
fn materials_of<'a>(appearance: &Appearance<'a>, clay: &'a [Material; 1]) -> &'a [Material] {
    if appearance.materials.is_empty() { clay } else { appearance.materials }
}

/// The words of the normals at the corners of all triangles.
fn normal_words<'a>(
    mesh: &Mesh<'_>,
    appearance: &'a Appearance<'_>,
) -> impl Iterator<Item = u32> + use<'a> {
    let normal = |i: u32| {
        let normal = appearance.normals.get(i as usize).copied().unwrap_or_default();
        if normal.iter().all(|part| part.is_finite()) { normalized(normal) } else { [0.0; 3] }
    };
    (0..mesh.len()).flat_map(move |triangle| {
        let corners = appearance.normal_indices.get(triangle).copied().unwrap_or([NONE; 3]);
        corners.into_iter().flat_map(normal).map(f32::to_bits)
    })
}
