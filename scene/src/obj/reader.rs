//! Text to triangles.

use super::corner::{Corner, Elements};
use super::error::{Element, ObjProblem};
use super::lines::{self, Lines};
use crate::budget::Budget;
use crate::from_file::quoted_word;
use crate::{Group, Material, Notes, Scene, normals};
use splitplane_core::mesh::MAX_TRIANGLES;
use std::collections::HashMap;

/// Most materials of a file; what each takes is many times its line.
const MAX_MATERIALS: usize = 1 << 20;

/// Where a problem is, and what.
pub(super) type Located = (Option<u64>, ObjProblem);

/// The scene, its materials not yet coloured, and what follows every `mtllib`. `memory` is a scene
/// whose arrays are used again; nothing else of it stays. What lists take counts for the budget, and is not given back.
pub(super) fn read(
    text: &str,
    name: &str,
    memory: Scene,
    budget: &Budget,
) -> Result<(Scene, Vec<String>), Located> {
    let mut reader = Reader::new(name, memory, budget);
    // A list that grows is there twice while it moves.
    let joined = if budget.is_limited() { 3 * lines::longest_joined(text) } else { 0 };
    budget.take(joined).map_err(|full| (None, full.into()))?;
    for (line, content) in Lines::new(text) {
        reader.line(line, &content).map_err(|problem| (Some(line), problem))?;
    }
    budget.give(joined);
    reader.finish()
}

struct Reader<'b> {
    budget: &'b Budget,
    scene: Scene,
    libraries: Vec<String>,
    material_by_name: HashMap<String, u32>,
    /// The material in use; `None` before the first `usemtl`.
    material: Option<u32>,
    /// Corners of the face being read, kept to spare allocations.
    corners: Vec<Corner>,
    elements: Elements,
    /// How many lines had an unknown keyword, and the first of them.
    unknown: (u64, Option<(u64, String)>),
}

impl<'b> Reader<'b> {
    fn new(name: &str, mut scene: Scene, budget: &'b Budget) -> Reader<'b> {
        scene.name.clear();
        scene.name.push_str(name);
        scene.positions.clear();
        scene.indices.clear();
        scene.normals.clear();
        scene.normal_indices.clear();
        scene.texcoords.clear();
        scene.texcoord_indices.clear();
        scene.material_of.clear();
        scene.materials.clear();
        scene.textures.clear();
        scene.lights.clear();
        scene.groups.clear();
        scene.camera = None;
        scene.notes = Notes::default();
        Reader {
            budget,
            scene,
            libraries: Vec::new(),
            material_by_name: HashMap::new(),
            material: None,
            corners: Vec::new(),
            elements: Elements::default(),
            unknown: (0, None),
        }
    }

    fn line(&mut self, line: u64, content: &str) -> Result<(), ObjProblem> {
        let (keyword, rest) = match content.split_once(|c: char| c.is_ascii_whitespace()) {
            Some((keyword, rest)) => (keyword, rest.trim_ascii()),
            None => (content, ""),
        };
        match keyword {
            "v" => self.vertex(rest)?,
            "vt" => self.texcoord(rest)?,
            "vn" => self.normal(rest)?,
            "f" | "fo" => self.face(line, rest)?,
            "usemtl" => self.use_material(rest)?,
            // Some programs write it before every face.
            "mtllib" if self.libraries.last().is_some_and(|last| last == rest) => {}
            "mtllib" => {
                let library = self.copied(rest)?;
                self.budget.push(&mut self.libraries, library)?;
            }
            "g" | "o" => self.group(keyword == "o", rest)?,
            "p" | "l" => self.scene.notes.skipped_elements += 1,
            "curv" | "curv2" | "surf" => self.scene.notes.skipped_freeform += 1,
            // What says nothing about triangles.
            "" | "vp" | "s" | "mg" | "bevel" | "c_interp" | "d_interp" | "lod" | "usemap"
            | "maplib" | "shadow_obj" | "trace_obj" | "cstype" | "deg" | "bmat" | "step"
            | "parm" | "trim" | "hole" | "scrv" | "sp" | "end" | "con" | "ctech" | "stech" => {}
            _ => {
                self.unknown.0 += 1;
                self.unknown.1.get_or_insert_with(|| (line, quoted_word(keyword)));
            }
        }
        Ok(())
    }

    fn vertex(&mut self, rest: &str) -> Result<(), ObjProblem> {
        let position: [f32; 3] = numbers(Element::Vertex, rest, 3)?;
        self.elements.positions.add()?;
        if !position.iter().all(|x| x.is_finite()) {
            self.scene.notes.non_finite_vertices += 1;
        }
        Ok(self.budget.push(&mut self.scene.positions, position)?)
    }

    fn texcoord(&mut self, rest: &str) -> Result<(), ObjProblem> {
        // One of one number lies on a line; a third one is depth in a solid texture.
        let texcoord: [f32; 2] = numbers(Element::TextureCoordinate, rest, 1)?;
        self.elements.texcoords.add()?;
        Ok(self.budget.push(&mut self.scene.texcoords, texcoord)?)
    }

    fn normal(&mut self, rest: &str) -> Result<(), ObjProblem> {
        let normal: [f32; 3] = numbers(Element::Normal, rest, 3)?;
        self.elements.normals.add()?;
        Ok(self.budget.push(&mut self.scene.normals, normals::unit(normal.map(f64::from)))?)
    }

    fn face(&mut self, line: u64, rest: &str) -> Result<(), ObjProblem> {
        self.corners.clear();
        for word in rest.split_ascii_whitespace() {
            let corner = self.elements.corner(line, word, self.budget)?;
            self.budget.push(&mut self.corners, corner)?;
        }
        let [first, others @ ..] = &self.corners[..] else {
            self.scene.notes.skipped_elements += 1;
            return Ok(());
        };
        if others.len() < 2 {
            self.scene.notes.skipped_elements += 1;
            return Ok(());
        }
        if self.scene.indices.len() + others.len() - 1 > MAX_TRIANGLES {
            return Err(ObjProblem::TooManyTriangles);
        }
        let material = match self.material {
            Some(material) => material,
            None => {
                self.scene.materials.push(Material::clay());
                *self.material.insert(self.scene.materials.len() as u32 - 1)
            }
        };
        let (scene, budget) = (&mut self.scene, self.budget);
        let before = scene.indices.len();
        let added = others.len() - 1;
        budget.grow(&mut scene.indices, added)?;
        budget.grow(&mut scene.material_of, added)?;
        for pair in others.windows(2) {
            scene.indices.push([*first, pair[0], pair[1]].map(|corner| corner.position));
            scene.material_of.push(material);
        }
        let fan = || others.windows(2).map(|pair| [*first, pair[0], pair[1]]);
        // Most large files have neither: an array begins with the first face that needs it.
        if self.corners.iter().any(|corner| corner.texcoord != Scene::NONE) {
            let missing = before - scene.texcoord_indices.len();
            budget.grow(&mut scene.texcoord_indices, missing + added)?;
            scene.texcoord_indices.resize(before, [Scene::NONE; 3]);
            scene.texcoord_indices.extend(fan().map(|corners| corners.map(|c| c.texcoord)));
        }
        if self.corners.iter().any(|corner| corner.normal != Scene::NONE) {
            let missing = before - scene.normal_indices.len();
            budget.grow(&mut scene.normal_indices, missing + added)?;
            scene.normal_indices.resize(before, [Scene::NONE; 3]);
            scene.normal_indices.extend(fan().map(|corners| corners.map(|c| c.normal)));
        }
        Ok(())
    }

    fn group(&mut self, is_object: bool, name: &str) -> Result<(), ObjProblem> {
        let first_triangle = self.scene.indices.len() as u32;
        let called = self.copied(name)?;
        let groups = &mut self.scene.groups;
        // One that no triangle is in was not begun.
        if let Some(last) = groups.last_mut()
            && (last.is_object, last.first_triangle) == (is_object, first_triangle)
        {
            self.budget.give(last.name.len() as u64);
            last.name = called;
            return Ok(());
        }
        Ok(self.budget.push(groups, Group { is_object, name: called, first_triangle })?)
    }

    fn copied(&self, name: &str) -> Result<String, ObjProblem> {
        self.budget.take(name.len() as u64)?;
        Ok(name.to_owned())
    }

    fn use_material(&mut self, name: &str) -> Result<(), ObjProblem> {
        if let Some(known) = self.material_by_name.get(name) {
            self.material = Some(*known);
            return Ok(());
        }
        let next = self.scene.materials.len();
        if next >= MAX_MATERIALS {
            return Err(ObjProblem::TooManyMaterials(MAX_MATERIALS));
        }
        self.budget.grow_map(&mut self.material_by_name)?;
        let (key, name) = (self.copied(name)?, self.copied(name)?);
        self.material_by_name.insert(key, next as u32);
        self.budget.push(&mut self.scene.materials, Material { name, ..Material::clay() })?;
        self.material = Some(next as u32);
        Ok(())
    }

    fn finish(mut self) -> Result<(Scene, Vec<String>), Located> {
        if let Some((line, problem)) = self.elements.missing() {
            return Err((Some(line), problem));
        }
        if self.scene.indices.is_empty() {
            return Err((None, ObjProblem::NoTriangles));
        }
        let triangles = self.scene.indices.len();
        let Scene { normal_indices, texcoord_indices, .. } = &mut self.scene;
        for corners in [normal_indices, texcoord_indices] {
            let missing = if corners.is_empty() { 0 } else { triangles - corners.len() };
            self.budget.grow(corners, missing).map_err(|full| (None, full.into()))?;
        }
        normals::leave_out_unusable(&mut self.scene);
        if let (count, Some((line, keyword))) = self.unknown {
            self.scene.notes.warnings.push(format!(
                "{count} lines with unknown keywords skipped, the first is line {line}: `{keyword}`"
            ));
        }
        Ok((self.scene, self.libraries))
    }
}

/// The numbers of a line, of which the first `least` must be there; the rest are 0. More may follow:
/// a weight, a colour, a depth.
fn numbers<const N: usize>(of: Element, rest: &str, least: usize) -> Result<[f32; N], ObjProblem> {
    let mut values = [0.0f32; N];
    let mut words = rest.split_ascii_whitespace();
    for (found, value) in values.iter_mut().enumerate() {
        match words.next() {
            Some(word) => {
                *value = word.parse().map_err(|_| ObjProblem::BadNumber(quoted_word(word)))?;
            }
            None if found >= least => break,
            None => return Err(ObjProblem::FewNumbers { of, found }),
        }
    }
    match words.find(|word| word.parse::<f32>().is_err()) {
        Some(word) => Err(ObjProblem::BadNumber(quoted_word(word))),
        None => Ok(values),
    }
}
