//! Nodes: where they are, and the instances, cameras and lights that they carry.

use super::buffers::Buffers;
use super::materials::Looks;
use super::meshes::Meshes;
use super::{MISSING, at, wrong};
use crate::instanced::{InstancedScene, Placed};
use crate::mesh_file::{Located, MeshFileProblem};
use crate::{Camera, Light};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use gltf_json::extensions::scene::khr_lights_punctual::{Light as OwnLight, Type as LightType};
use gltf_json::validation::Checked;
use gltf_json::{Node, Root};
use splitplane_core::scene::{ObjectSpace, Transform};

/// Most instances, as in scene files.
const MOST_INSTANCES: usize = 1 << 24;

/// Where a node is within its parent.
#[derive(Clone, Copy)]
pub(super) enum Local {
    Matrix(DAffine3),
    Parts { translation: DVec3, rotation: DQuat, scale: DVec3 },
}

impl Local {
    /// The affine map.
    pub(super) fn map(&self) -> DAffine3 {
        match *self {
            Local::Matrix(map) => map,
            Local::Parts { translation, rotation, scale } => {
                DAffine3::from_scale_rotation_translation(scale, rotation, translation)
            }
        }
    }
}

/// A node of the scene.
pub(super) struct Found {
    /// Its number in the file.
    pub(super) node: usize,
    /// The place of its parent in the list, which is before its own.
    pub(super) parent: Option<usize>,
    pub(super) local: Local,
    pub(super) world: DAffine3,
}

/// The nodes of the scene, parents before children.
pub(super) fn walk(root: &Root) -> Result<Vec<Found>, Located> {
    let scene = root.scene.map_or(0, |scene| scene.value());
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        let child = is_child.get_mut(child.value());
        *child.ok_or_else(|| wrong("nodes", MISSING))? = true;
    }
    let roots: Vec<usize> = match root.scenes.get(scene) {
        Some(scene) => scene.nodes.iter().map(|node| node.value()).collect(),
        // A file without scenes is a library; all that it has is shown.
        None => (0..root.nodes.len()).filter(|node| !is_child[*node]).collect(),
    };
    let mut seen = vec![false; root.nodes.len()];
    let mut found: Vec<Found> = Vec::new();
    let mut open: Vec<(usize, Option<usize>)> = Vec::new();
    open.extend(roots.iter().rev().map(|node| (*node, None)));
    while let Some((node, parent)) = open.pop() {
        let before = seen.get_mut(node).map(|seen| std::mem::replace(seen, true));
        if before.ok_or_else(|| wrong("scenes", MISSING))? {
            let sentence = "the node is the child of two nodes, or of one below itself";
            return Err(wrong(format!("nodes[{node}]"), sentence));
        }
        let own = &root.nodes[node];
        let local =
            local(own).map_err(|what| wrong(format!("nodes[{node}].{}", what.0), what.1))?;
        let above = parent.map_or(DAffine3::IDENTITY, |parent: usize| found[parent].world);
        let place = found.len();
        found.push(Found { node, parent, local, world: above * local.map() });
        let children = own.children.iter().flatten().rev();
        open.extend(children.map(|child| (child.value(), Some(place))));
    }
    Ok(found)
}

fn local(node: &Node) -> Result<Local, (&'static str, &'static str)> {
    let finite = "the numbers must be finite";
    if let Some(matrix) = node.matrix {
        if !matrix.iter().all(|x| x.is_finite()) {
            return Err(("matrix", finite));
        }
        let column =
            |at: usize| DVec3::from_array(std::array::from_fn(|k| f64::from(matrix[at + k])));
        let axes = DMat3::from_cols(column(0), column(4), column(8));
        return Ok(Local::Matrix(DAffine3::from_mat3_translation(axes, column(12))));
    }
    let translation = node.translation.unwrap_or_default();
    let rotation = node.rotation.unwrap_or_default().0;
    let scale = node.scale.unwrap_or([1.0; 3]);
    let all = translation.iter().chain(&rotation).chain(&scale);
    if !all.copied().all(f32::is_finite) {
        return Err(("translation", finite));
    }
    let rotation = unit(rotation.map(f64::from)).ok_or(("rotation", "the rotation is zero"))?;
    let [translation, scale] = [translation, scale].map(|v| DVec3::from_array(v.map(f64::from)));
    Ok(Local::Parts { translation, rotation, scale })
}

/// A quaternion at length 1.
pub(super) fn unit(rotation: [f64; 4]) -> Option<DQuat> {
    let rotation = DQuat::from_array(rotation);
    let length = rotation.length();
    (length > 0.0 && length.is_finite()).then(|| rotation * (1.0 / length))
}

/// The map as a transform, rounded once.
fn transform(map: &DAffine3) -> Transform {
    let [x, y, z] = map.matrix3.to_cols_array_2d();
    let origin = map.translation.to_array();
    std::array::from_fn(|row| [x[row], y[row], z[row], origin[row]].map(|part| part as f32))
}

/// Adds the instances; gives for each the place of its node in the list.
pub(super) fn place(
    root: &Root,
    nodes: &[Found],
    buffers: &mut Buffers<'_>,
    looks: &Looks,
    scene: &mut InstancedScene,
) -> Result<Vec<usize>, Located> {
    let mut meshes = Meshes::new(looks);
    let (mut flat, mut skinned) = (0u64, 0u64);
    let mut places = Vec::new();
    for (place, found) in nodes.iter().enumerate() {
        let own = &root.nodes[found.node];
        let Some(mesh) = own.mesh else { continue };
        let Some(geometry) = meshes.get(mesh, buffers, scene)? else { continue };
        skinned += u64::from(own.skin.is_some());
        let transform = transform(&found.world);
        // Scales of 0 hide objects in many files.
        if ObjectSpace::new(&transform).is_none() {
            flat += 1;
            continue;
        }
        if scene.instances.len() >= MOST_INSTANCES {
            let most = MOST_INSTANCES as u64;
            let problem = MeshFileProblem::TooMany { what: "nodes with a mesh", most };
            return Err(at(format!("nodes[{}]", found.node), problem));
        }
        scene.instances.push(Placed { id: found.node as u32, ..Placed::new(geometry, transform) });
        places.push(place);
    }
    meshes.note(scene);
    let warnings = &mut scene.parts.notes.warnings;
    if flat > 0 {
        warnings.push(format!(
            "{flat} nodes are left out: their place has no inverse, such as a scale of 0"
        ));
    }
    if skinned > 0 {
        warnings.push(format!("{skinned} skinned meshes stand as they are without their skin"));
    }
    Ok(places)
}

/// The first camera, and all lights.
pub(super) fn cameras_and_lights(root: &Root, nodes: &[Found], scene: &mut InstancedScene) {
    let (mut cameras, mut spots, mut odd) = (0u64, 0u64, 0u64);
    let lights = root.extensions.as_ref().and_then(|own| own.khr_lights_punctual.as_ref());
    for found in nodes {
        let own = &root.nodes[found.node];
        if let Some(camera) = own.camera {
            let own = root.cameras.get(camera.value());
            match own.and_then(|own| camera_of(own, &found.world)) {
                Some(camera) if scene.parts.camera.is_none() => scene.parts.camera = Some(camera),
                _ => cameras += 1,
            }
        }
        let light = own.extensions.as_ref().and_then(|own| own.khr_lights_punctual.as_ref());
        let light = light.and_then(|own| lights?.lights.get(own.light.value()));
        if let Some(light) = light {
            spots += u64::from(matches!(light.type_, Checked::Valid(LightType::Spot)));
            match light_of(light, &found.world) {
                Some(light) => scene.parts.lights.push(light),
                None => odd += 1,
            }
        }
    }
    let warnings = &mut scene.parts.notes.warnings;
    for (count, what) in [
        (cameras, "cameras are left out: the first perspective one counts"),
        (spots, "spot lights shine all around"),
        (odd, "lights are left out: their numbers are not finite, or negative"),
    ] {
        if count > 0 {
            warnings.push(format!("{count} {what}"));
        }
    }
}

fn camera_of(own: &gltf_json::Camera, world: &DAffine3) -> Option<Camera> {
    let fov = f64::from(own.perspective.as_ref()?.yfov).to_degrees() as f32;
    let eye = world.translation;
    let forward = (-world.matrix3.z_axis).try_normalize()?;
    let up = world.matrix3.y_axis.try_normalize()?;
    // As far off as the eye is from the origin: then rounding to f32 turns the view the least.
    let distance = if eye.length() > 0.0 { eye.length() } else { 1.0 };
    let [eye, look_at, up] = [eye, eye + forward * distance, up].map(|v| v.as_vec3().to_array());
    Camera::new(eye, look_at, up, fov).ok()
}

fn light_of(own: &OwnLight, world: &DAffine3) -> Option<Light> {
    let irradiance = own.color.map(|part| part * own.intensity);
    if !irradiance.iter().all(|part| part.is_finite() && *part >= 0.0) {
        return None;
    }
    let position = world.translation.as_vec3().to_array();
    match own.type_ {
        Checked::Valid(LightType::Directional) => {
            let towards = world.matrix3.z_axis.try_normalize()?.as_vec3().to_array();
            Some(Light::Directional { towards, irradiance })
        }
        Checked::Valid(_) if position.iter().all(|x| x.is_finite()) => {
            Some(Light::Point { position, irradiance, distance: 1.0 })
        }
        _ => None,
    }
}
