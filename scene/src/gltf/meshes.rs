//! Meshes to geometries.

use super::buffers::Buffers;
use super::materials::{Looks, Wrap};
use super::{MISSING, at, wrong};
use crate::instanced::InstancedScene;
use crate::mesh_file::{Located, MeshFileProblem, room};
use crate::{Material, Scene, normals};
use gltf_json::accessor::Type;
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::validation::Checked;
use gltf_json::{Index, Mesh};
use splitplane_core::mesh::MAX_TRIANGLES;
use std::collections::HashMap;

/// What was read of a mesh's accessors: many of its primitives may share them.
#[derive(Default)]
struct Known {
    /// The number of the first vertex, and how many there are.
    positions: HashMap<usize, (u32, u32)>,
    normals: HashMap<usize, u32>,
    /// By accessor and by what a material does with its numbers.
    texcoords: HashMap<(usize, usize), u32>,
}

/// Reads the meshes that instances need, each once.
pub(super) struct Meshes<'l> {
    looks: &'l Looks,
    /// The geometry of a mesh; none inside for a mesh without triangles.
    known: HashMap<usize, Option<u32>>,
    coloured: u64,
    morphed: u64,
}

impl<'l> Meshes<'l> {
    pub(super) fn new(looks: &'l Looks) -> Meshes<'l> {
        Meshes { looks, known: HashMap::new(), coloured: 0, morphed: 0 }
    }

    /// The geometry of a mesh, if it has triangles.
    pub(super) fn get(
        &mut self,
        index: Index<Mesh>,
        buffers: &mut Buffers<'_>,
        scene: &mut InstancedScene,
    ) -> Result<Option<u32>, Located> {
        if let Some(known) = self.known.get(&index.value()) {
            return Ok(*known);
        }
        let mesh = buffers.root().meshes.get(index.value());
        let mesh = mesh.ok_or_else(|| wrong("nodes", MISSING))?;
        let mut from = Scene::default();
        let mut known = Known::default();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let field = format!("meshes[{}].primitives[{number}]", index.value());
            self.primitive(primitive, &field, buffers, &mut known, &mut from, scene)?;
        }
        let geometry = if from.indices.is_empty() {
            None
        } else {
            normals::leave_out_unusable(&mut from);
            let notes = &mut scene.parts.notes;
            let odd = |point: &&[f32; 3]| !point.iter().all(|x| x.is_finite());
            notes.non_finite_vertices += from.positions.iter().filter(odd).count() as u64;
            notes.unusable_normals += from.notes.unusable_normals;
            notes.unusable_texcoords += from.notes.unusable_texcoords;
            if scene.parts.indices.len() + from.indices.len() > MAX_TRIANGLES {
                let what = "triangles in all meshes together";
                let problem = MeshFileProblem::TooMany { what, most: MAX_TRIANGLES as u64 };
                return Err(at(format!("meshes[{}]", index.value()), problem));
            }
            let name = mesh.name.clone().unwrap_or_else(|| format!("mesh {}", index.value()));
            let all = 0..from.indices.len() as u32;
            Some(scene.add_geometry(&name, &from, &[all], 0))
        };
        self.known.insert(index.value(), geometry);
        Ok(geometry)
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        field: &str,
        buffers: &mut Buffers<'_>,
        known: &mut Known,
        from: &mut Scene,
        scene: &mut InstancedScene,
    ) -> Result<(), Located> {
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        // Points and lines.
        let Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) =
            primitive.mode
        else {
            scene.parts.notes.skipped_elements += 1;
            return Ok(());
        };
        let Some(positions) = attribute(Semantic::Positions) else {
            scene.parts.notes.skipped_elements += 1;
            return Ok(());
        };
        self.coloured += u64::from(attribute(Semantic::Colors(0)).is_some());
        self.morphed += u64::from(primitive.targets.as_ref().is_some_and(|own| !own.is_empty()));
        let (first, count) = match known.positions.get(&positions.value()) {
            Some(known) => *known,
            None => {
                let mut own = buffers.numbers::<3>(positions, Type::Vec3)?;
                let (first, count) = (from.positions.len(), own.len());
                if first + count > u32::MAX as usize {
                    let problem =
                        MeshFileProblem::TooMany { what: "vertices", most: u64::from(u32::MAX) };
                    return Err(at(field, problem));
                }
                from.positions.append(&mut own);
                *known.positions.entry(positions.value()).or_insert((first as u32, count as u32))
            }
        };
        // Numbers of vertices count from the primitive's first one.
        let triangles = triangles(primitive, mode, count, field, buffers)?;
        if from.indices.len() + triangles.len() > MAX_TRIANGLES {
            let what = "triangles";
            return Err(at(field, MeshFileProblem::TooMany { what, most: MAX_TRIANGLES as u64 }));
        }
        let memory = |problem| at(field, problem);
        let before = from.indices.len();
        room(&mut from.indices, triangles.len()).map_err(memory)?;
        room(&mut from.material_of, triangles.len()).map_err(memory)?;
        let shifted =
            |first: u32| triangles.iter().map(move |corners| corners.map(|corner| corner + first));
        from.indices.extend(shifted(first));
        if let Some(normals) = attribute(Semantic::Normals) {
            let first = match known.normals.get(&normals.value()) {
                Some(known) => *known,
                None => {
                    let own = buffers.numbers::<3>(normals, Type::Vec3)?;
                    let first = from.normals.len() as u32;
                    same(own.len(), count, || format!("{field}.attributes.NORMAL"))?;
                    from.normals.extend(own.iter().map(|n| normals::unit(n.map(f64::from))));
                    *known.normals.entry(normals.value()).or_insert(first)
                }
            };
            room(&mut from.normal_indices, before + triangles.len()).map_err(memory)?;
            from.normal_indices.resize(before, [Scene::NONE; 3]);
            from.normal_indices.extend(shifted(first));
        }
        let material = primitive.material.map(|material| material.value());
        if material.is_some_and(|material| material >= self.looks.wraps.len()) {
            return Err(wrong(format!("{field}.material"), MISSING));
        }
        if let Some(number) = material
            && let Some(wrap) = &self.looks.wraps[number]
            && let Some(texcoords) = attribute(Semantic::TexCoords(wrap.set))
        {
            let key = (texcoords.value(), number);
            let first = match known.texcoords.get(&key) {
                Some(known) => *known,
                None => {
                    let own = buffers.numbers::<2>(texcoords, Type::Vec2)?;
                    let first = from.texcoords.len() as u32;
                    same(own.len(), count, || format!("{field}.attributes.TEXCOORD"))?;
                    from.texcoords.extend(own.iter().map(|own| Wrap::apply(wrap, *own)));
                    *known.texcoords.entry(key).or_insert(first)
                }
            };
            room(&mut from.texcoord_indices, before + triangles.len()).map_err(memory)?;
            from.texcoord_indices.resize(before, [Scene::NONE; 3]);
            from.texcoord_indices.extend(shifted(first));
        }
        let number = material.map_or_else(|| clay(scene), |material| material as u32);
        from.material_of.resize(from.indices.len(), number);
        Ok(())
    }

    /// Says what all meshes lost.
    pub(super) fn note(&self, scene: &mut InstancedScene) {
        let warnings = &mut scene.parts.notes.warnings;
        if self.coloured > 0 {
            warnings
                .push(format!("the vertex colours of {} primitives are left out", self.coloured));
        }
        if self.morphed > 0 {
            warnings.push(format!("the morph targets of {} primitives are left out", self.morphed));
        }
    }
}

fn same(found: usize, count: u32, field: impl Fn() -> String) -> Result<(), Located> {
    match found == count as usize {
        true => Ok(()),
        false => {
            Err(wrong(field(), format!("it has {found} elements, but there are {count} vertices")))
        }
    }
}

/// The triangles of a primitive, by the numbers of its own vertices.
fn triangles(
    primitive: &Primitive,
    mode: Mode,
    count: u32,
    field: &str,
    buffers: &mut Buffers<'_>,
) -> Result<Vec<[u32; 3]>, Located> {
    let corners: Vec<u32> = match primitive.indices {
        Some(indices) => {
            let own = buffers.indices(indices)?;
            if let Some(bad) = own.iter().find(|corner| **corner >= count) {
                let (what, index, count) = ("vertex", i64::from(*bad), u64::from(count));
                let problem = MeshFileProblem::PastEnd { what, index, count };
                return Err(at(format!("{field}.indices"), problem));
            }
            own
        }
        None => {
            buffers.spend(4 * u64::from(count), || field.to_owned())?;
            (0..count).collect()
        }
    };
    buffers.spend(12 * corners.len() as u64, || field.to_owned())?;
    Ok(match mode {
        Mode::TriangleStrip => {
            let three = |(place, three): (usize, &[u32])| match place % 2 {
                0 => [three[0], three[1], three[2]],
                _ => [three[1], three[0], three[2]],
            };
            corners.windows(3).enumerate().map(three).collect()
        }
        Mode::TriangleFan => match corners.split_first() {
            Some((first, others)) => {
                others.windows(2).map(|two| [*first, two[0], two[1]]).collect()
            }
            None => Vec::new(),
        },
        _ => corners.as_chunks::<3>().0.to_vec(),
    })
}

/// The number of the material of triangles without one.
fn clay(scene: &mut InstancedScene) -> u32 {
    let materials = &mut scene.parts.materials;
    let clay = Material::clay();
    if let Some(there) = materials.iter().position(|material| *material == clay) {
        return there as u32;
    }
    materials.push(clay);
    materials.len() as u32 - 1
}
