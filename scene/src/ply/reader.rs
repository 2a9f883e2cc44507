//! Elements to triangles and points.

use super::body::Body;
use super::header::{Element, Header, Property};
use crate::from_file::quoted;
use crate::mesh_file::{Located, MeshFileProblem, room};
use crate::{Material, Scene, normals};
use splitplane_core::mesh::MAX_TRIANGLES;

/// Most other elements that are named in notes.
const MOST_NOTES: usize = 16;

/// What a number of a vertex is.
#[derive(Clone, Copy)]
enum Part {
    Position(usize),
    Normal(usize),
}

impl Part {
    fn of(property: &Property) -> Option<Part> {
        Some(match (property.count, property.name.as_str()) {
            (None, "x") => Part::Position(0),
            (None, "y") => Part::Position(1),
            (None, "z") => Part::Position(2),
            (None, "nx") => Part::Normal(0),
            (None, "ny") => Part::Normal(1),
            (None, "nz") => Part::Normal(2),
            _ => return None,
        })
    }
}

/// The positions of all vertices.
pub(super) fn points(bytes: &[u8]) -> Result<Vec<[f32; 3]>, Located> {
    let header = Header::read(bytes)?;
    let mut body = Body::new(bytes, header.form, header.end, header.lines);
    for element in &header.elements {
        body.check(element)?;
        if element.name == "vertex" {
            return Ok(vertices(&mut body, element)?.0);
        }
        skip(&mut body, element)?;
    }
    Ok(Vec::new())
}

/// The mesh. It may have no triangles.
pub(super) fn mesh(bytes: &[u8], name: &str) -> Result<Scene, Located> {
    let header = Header::read(bytes)?;
    let mut body = Body::new(bytes, header.form, header.end, header.lines);
    let vertex_count = header.elements.iter().find(|element| element.name == "vertex");
    let vertex_count = vertex_count.map_or(0, |element| element.count);
    let mut scene = Scene { name: name.to_owned(), ..Scene::default() };
    let mut others = 0;
    for element in &header.elements {
        body.check(element)?;
        match element.name.as_str() {
            "vertex" => (scene.positions, scene.normals) = vertices(&mut body, element)?,
            "face" | "tristrips" => {
                faces(&mut body, element, vertex_count, &mut scene)?;
            }
            name => {
                skip(&mut body, element)?;
                others += usize::from(element.count > 0);
                if (1..=MOST_NOTES).contains(&others) && element.count > 0 {
                    let (name, count) = (quoted(name), element.count);
                    let note = format!("{count} elements `{name}` are skipped");
                    scene.notes.warnings.push(note);
                }
            }
        }
    }
    let odd = |point: &&[f32; 3]| !point.iter().all(|x| x.is_finite());
    scene.notes.non_finite_vertices = scene.positions.iter().filter(odd).count() as u64;
    if !scene.normals.is_empty() {
        room(&mut scene.normal_indices, scene.indices.len()).map_err(|problem| (None, problem))?;
        scene.normal_indices.extend_from_slice(&scene.indices);
        normals::leave_out_unusable(&mut scene);
    }
    note_colours(&header, &mut scene);
    room(&mut scene.material_of, scene.indices.len()).map_err(|problem| (None, problem))?;
    scene.material_of.resize(scene.indices.len(), 0);
    scene.materials = vec![Material::clay()];
    Ok(scene)
}

fn note_colours(header: &Header, scene: &mut Scene) {
    for element in &header.elements {
        let colour = |property: &Property| matches!(property.name.as_str(), "red" | "diffuse_red");
        if matches!(element.name.as_str(), "vertex" | "face")
            && element.properties.iter().any(colour)
        {
            let (kind, count) = (&element.name, element.count);
            scene.notes.warnings.push(format!("the colours of {count} elements `{kind}` are left out; materials have none by vertex or face"));
        }
    }
}

/// Positions and unit normals.
type Vertices = (Vec<[f32; 3]>, Vec<[f32; 3]>);

/// The vertices; no normals where there are none.
fn vertices(body: &mut Body<'_>, element: &Element) -> Result<Vertices, Located> {
    let parts: Vec<Option<Part>> = element.properties.iter().map(Part::of).collect();
    let has = |name: &str| element.properties.iter().filter(|own| own.name == name).count();
    let missing = ["x", "y", "z"].into_iter().find(|name| has(name) != 1);
    if let Some(name) = missing.filter(|_| element.count > 0) {
        let sentence = format!("a vertex needs one property `{name}`, this one has {}", has(name));
        let place = crate::mesh_file::Place::Line(element.line);
        return Err((Some(place), MeshFileProblem::Wrong(sentence)));
    }
    let has_normals = ["nx", "ny", "nz"].into_iter().all(|name| has(name) == 1);
    // The check of counts keeps both within a few times the file's bytes.
    let count = element.count;
    if count > u64::from(u32::MAX) {
        let problem = MeshFileProblem::TooMany { what: "vertices", most: u64::from(u32::MAX) };
        return Err((body.place(), problem));
    }
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let memory = |problem| (None, problem);
    if element.properties.is_empty() {
        return Ok((positions, normals));
    }
    room(&mut positions, count as usize).map_err(memory)?;
    if has_normals {
        room(&mut normals, count as usize).map_err(memory)?;
    }
    for _ in 0..count {
        let (mut position, mut normal) = ([0.0; 3], [0.0; 3]);
        for (property, part) in element.properties.iter().zip(&parts) {
            match part {
                Some(Part::Position(axis)) => {
                    position[*axis] = body.number(property.of, property)? as f32;
                }
                Some(Part::Normal(axis)) => normal[*axis] = body.number(property.of, property)?,
                None => skip_property(body, property)?,
            }
        }
        body.end(element)?;
        positions.push(position);
        if has_normals {
            normals.push(normals::unit(normal));
        }
    }
    Ok((positions, normals))
}

/// Adds the triangles of faces or strips. `vertices` are those that there will be.
fn faces(
    body: &mut Body<'_>,
    element: &Element,
    vertices: u64,
    scene: &mut Scene,
) -> Result<(), Located> {
    let is_corners = |property: &Property| {
        property.count.is_some()
            && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
    };
    let named = element.properties.iter().filter(|property| is_corners(property)).count();
    if named != 1 && element.count > 0 {
        let name = &element.name;
        let sentence =
            format!("an element `{name}` needs one list `vertex_indices`, this one has {named}");
        let place = crate::mesh_file::Place::Line(element.line);
        return Err((Some(place), MeshFileProblem::Wrong(sentence)));
    }
    let strips = element.name == "tristrips";
    let mut corners = Vec::new();
    for _ in 0..if element.properties.is_empty() { 0 } else { element.count } {
        for property in &element.properties {
            match property.count {
                Some(count) if is_corners(property) => {
                    let length = body.list(count, property)?;
                    corners.clear();
                    room(&mut corners, length as usize).map_err(|problem| (None, problem))?;
                    for _ in 0..length {
                        let corner = corner(body, property, vertices, strips)?;
                        corners.push(corner);
                    }
                    let place = body.place();
                    add(scene, &corners, strips).map_err(|problem| (place, problem))?;
                }
                _ => skip_property(body, property)?,
            }
        }
        body.end(element)?;
    }
    Ok(())
}

/// A vertex; [`Scene::NONE`] where a strip ends.
fn corner(
    body: &mut Body<'_>,
    property: &Property,
    vertices: u64,
    strips: bool,
) -> Result<u32, Located> {
    let place = body.place();
    let index = body.number(property.of, property)?;
    if index >= 0.0 && index < vertices as f64 && index.fract() == 0.0 {
        return Ok(index as u32);
    }
    if strips && index == -1.0 {
        return Ok(Scene::NONE);
    }
    if index.fract() != 0.0 {
        return Err((place, MeshFileProblem::Wrong(format!("{index} is no index of a vertex"))));
    }
    let (what, index, count) = ("vertex", index as i64, vertices);
    Err((place, MeshFileProblem::PastEnd { what, index, count }))
}

fn add(scene: &mut Scene, corners: &[u32], strips: bool) -> Result<(), MeshFileProblem> {
    let more = corners.len().saturating_sub(2);
    if scene.indices.len() + more > MAX_TRIANGLES {
        let most = MAX_TRIANGLES as u64;
        return Err(MeshFileProblem::TooMany { what: "triangles", most });
    }
    room(&mut scene.indices, more)?;
    if !strips {
        scene.notes.skipped_elements += u64::from(corners.len() < 3);
        if let [first, others @ ..] = corners {
            scene.indices.extend(others.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        }
        return Ok(());
    }
    for strip in corners.split(|corner| *corner == Scene::NONE) {
        // Every other triangle of a strip is named the other way around.
        scene.indices.extend(strip.windows(3).enumerate().map(|(at, three)| {
            let [a, b, c] = [three[0], three[1], three[2]];
            if at % 2 == 0 { [a, b, c] } else { [b, a, c] }
        }));
    }
    Ok(())
}

fn skip(body: &mut Body<'_>, element: &Element) -> Result<(), Located> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            skip_property(body, property)?;
        }
        body.end(element)?;
    }
    Ok(())
}

fn skip_property(body: &mut Body<'_>, property: &Property) -> Result<(), Located> {
    let count = match property.count {
        Some(count) => body.list(count, property)?,
        None => 1,
    };
    body.skip(count, property)
}
