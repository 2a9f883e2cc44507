//! Scenes to `.glb`.

use crate::instanced::{InstancedScene, Placed};
use crate::mesh_file::MeshFileProblem;
use crate::{Light, Material, Scene, Texture};
use glam::{DMat3, DVec3};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde_json::{Map, Value, json};
use splitplane_float_state::Standard;
use std::collections::{BTreeMap, HashMap};

/// Kinds of numbers.
const UNSIGNED: u32 = 5125;
const FLOAT: u32 = 5126;

/// The scene as a `.glb` file: a mesh for each geometry (and material given to an instance), a node for each instance, the keys of those
/// that move as an animation; the camera, and lights as punctual ones; textures as PNG. Read again it has the same positions bit for bit
/// and the same triangles in the order of their materials. Spheres and capsules, masks, culling and users' numbers have no
/// place in it.
///
/// # Errors
/// It would have more bytes than the format can count.
pub fn to_glb(scene: &InstancedScene) -> Result<Vec<u8>, MeshFileProblem> {
    let _state = Standard::set();
    let mut out = Out::default();
    let parts = &scene.parts;
    let materials: Vec<Value> = parts.materials.iter().map(material).collect();
    let mut meshes: Vec<Value> = Vec::new();
    let mut known: HashMap<(u32, Option<u32>), usize> = HashMap::new();
    let mut nodes = Vec::new();
    let (mut channels, mut samplers) = (Vec::new(), Vec::new());
    for placed in &scene.instances {
        let key = (placed.geometry, placed.material);
        let number = *known.entry(key).or_insert_with(|| {
            meshes.push(mesh(scene, placed, &mut out));
            meshes.len() - 1
        });
        let mut node = node_of(placed);
        node.insert("mesh".into(), json!(number));
        if placed.keys.len() > 1 {
            let times: Vec<f32> = placed
                .keys
                .iter()
                .map(|key| (f64::from(key.frame) * scene.seconds_per_frame) as f32)
                .collect();
            let input = out.times(&times);
            let keys = || placed.keys.iter().map(|key| key.pose);
            let move_to: Vec<f32> =
                keys().flat_map(|pose| pose.translate).map(|x| x as f32).collect();
            let turn: Vec<f32> = keys().flat_map(|pose| pose.rotate).map(|x| x as f32).collect();
            let scale: Vec<f32> = keys().flat_map(|pose| pose.scale).map(|x| x as f32).collect();
            for (path, kind, values) in [
                ("translation", "VEC3", move_to),
                ("rotation", "VEC4", turn),
                ("scale", "VEC3", scale),
            ] {
                let output = out.floats(&values, times.len(), kind);
                channels.push(json!({"sampler": samplers.len(), "target": {"node": nodes.len(), "path": path}}));
                samplers.push(json!({"input": input, "output": output}));
            }
        }
        nodes.push(Value::Object(node));
    }
    // A mesh without triangles is none of the format.
    meshes.iter_mut().filter(|mesh| mesh["primitives"] == json!([])).for_each(|mesh| {
        let none = out.floats(&[0.0; 3], 1, "VEC3");
        *mesh = json!({"primitives": [{"attributes": {"POSITION": none}, "mode": 0}]});
    });
    let mut root = Map::new();
    let mut used = Vec::new();
    if let Some(camera) = &parts.camera {
        let (eye, at) = (point(camera.eye()), point(camera.look_at()));
        let [right, up] = camera.picture_axes().map(point);
        let axes = DMat3::from_cols(right, up, (eye - at).normalize());
        let yfov = f64::from(camera.fov_degrees()).to_radians();
        let znear = 1e-3 * (at - eye).length();
        root.insert(
            "cameras".into(),
            json!([{"type": "perspective", "perspective": {"yfov": yfov, "znear": znear}}]),
        );
        nodes.push(json!({"camera": 0, "matrix": columns(axes, eye)}));
    }
    let mut lights = Vec::new();
    for light in &parts.lights {
        let Some((own, axes, origin)) = light_of(light) else { continue };
        let named = json!({"KHR_lights_punctual": {"light": lights.len()}});
        nodes.push(json!({"matrix": columns(axes, origin), "extensions": named}));
        lights.push(own);
    }
    if !lights.is_empty() {
        used.push("KHR_lights_punctual");
        root.insert("extensions".into(), json!({"KHR_lights_punctual": {"lights": lights}}));
    }
    for name in [
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_transmission",
        "KHR_materials_volume",
    ] {
        if materials.iter().any(|own| own["extensions"].get(name).is_some()) {
            used.push(name);
        }
    }
    let mut images = Vec::new();
    for texture in &parts.textures {
        let view = out.view(&png(texture), 1);
        images.push(json!({"bufferView": view, "mimeType": "image/png", "name": texture.name()}));
    }
    if !images.is_empty() {
        let textures: Vec<Value> = (0..images.len()).map(|own| json!({"source": own})).collect();
        root.insert("textures".into(), json!(textures));
        root.insert("images".into(), json!(images));
    }
    if !channels.is_empty() {
        root.insert("animations".into(), json!([{"channels": channels, "samplers": samplers}]));
    }
    let all: Vec<usize> = (0..nodes.len()).collect();
    for (name, list) in [
        ("meshes", meshes),
        ("materials", materials),
        ("nodes", nodes),
        ("accessors", std::mem::take(&mut out.accessors)),
        ("bufferViews", std::mem::take(&mut out.views)),
        ("extensionsUsed", used.into_iter().map(Value::from).collect()),
    ] {
        // Lists are not empty in this format.
        if !list.is_empty() {
            root.insert(name.into(), Value::Array(list));
        }
    }
    root.insert("asset".into(), json!({"version": "2.0", "generator": "splitplane"}));
    root.insert("scene".into(), json!(0));
    root.insert("scenes".into(), json!([{"nodes": all}]));
    if !out.bytes.is_empty() {
        root.insert("buffers".into(), json!([{"byteLength": out.bytes.len()}]));
    }
    glb(Value::Object(root).to_string().into_bytes(), out.bytes)
}

fn glb(mut json: Vec<u8>, mut bin: Vec<u8>) -> Result<Vec<u8>, MeshFileProblem> {
    json.resize(json.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let length = 12 + 8 + json.len() + if bin.is_empty() { 0 } else { 8 + bin.len() };
    let length = u32::try_from(length).map_err(|_| MeshFileProblem::TooMany {
        what: "bytes of a .glb file",
        most: u64::from(u32::MAX),
    })?;
    let mut bytes = Vec::with_capacity(length as usize);
    bytes.extend(b"glTF");
    bytes.extend([2u32, length, json.len() as u32].map(u32::to_le_bytes).as_flattened());
    bytes.extend(b"JSON");
    bytes.append(&mut json);
    if !bin.is_empty() {
        bytes.extend((bin.len() as u32).to_le_bytes());
        bytes.extend(b"BIN\0");
        bytes.append(&mut bin);
    }
    Ok(bytes)
}

fn node_of(placed: &Placed) -> Map<String, Value> {
    let mut node = Map::new();
    match placed.keys.first() {
        Some(key) => {
            let pose = key.pose;
            node.insert("translation".into(), json!(pose.translate));
            node.insert("rotation".into(), json!(pose.rotate));
            node.insert("scale".into(), json!(pose.scale));
        }
        None => {
            let [x, y, z] = placed.transform;
            let columns: Vec<f32> =
                (0..4).flat_map(|k| [x[k], y[k], z[k], if k == 3 { 1.0 } else { 0.0 }]).collect();
            node.insert("matrix".into(), json!(columns));
        }
    }
    node
}

/// A geometry as one mesh, a primitive for each material.
fn mesh(scene: &InstancedScene, placed: &Placed, out: &mut Out) -> Value {
    let Some(own) = scene.geometries.get(placed.geometry as usize) else {
        return json!({"primitives": []});
    };
    let parts = &scene.parts;
    let mut by_material: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for triangle in own.triangles.start as usize..own.triangles.end as usize {
        let material = placed.material.unwrap_or(parts.material_of[triangle]);
        by_material.entry(material).or_default().push(triangle);
    }
    let first = own.vertices.start;
    let mut shared = None;
    let mut primitives = Vec::new();
    for (material, triangles) in by_material {
        let all = |corners: &[[u32; 3]]| {
            let named = |triangle: &usize| {
                corners.get(*triangle).is_some_and(|three| !three.contains(&Scene::NONE))
            };
            triangles.iter().all(named)
        };
        let has_texture =
            parts.materials.get(material as usize).is_some_and(|own| own.texture.is_some());
        let (normals, texcoords) =
            (all(&parts.normal_indices), has_texture && all(&parts.texcoord_indices));
        let mut attributes = Map::new();
        let mut corners: Vec<u32> = Vec::with_capacity(3 * triangles.len());
        if !normals && !texcoords {
            let range = own.vertices.start as usize..own.vertices.end as usize;
            let positions = *shared.get_or_insert_with(|| out.positions(&parts.positions[range]));
            attributes.insert("POSITION".into(), json!(positions));
            for triangle in &triangles {
                corners.extend(parts.indices[*triangle].map(|corner| corner - first));
            }
        } else {
            let mut numbers: HashMap<[u32; 3], u32> = HashMap::new();
            let mut order: Vec<[u32; 3]> = Vec::new();
            for triangle in &triangles {
                for k in 0..3 {
                    let named = [
                        parts.indices[*triangle][k],
                        if normals { parts.normal_indices[*triangle][k] } else { 0 },
                        if texcoords { parts.texcoord_indices[*triangle][k] } else { 0 },
                    ];
                    corners.push(*numbers.entry(named).or_insert_with(|| {
                        order.push(named);
                        order.len() as u32 - 1
                    }));
                }
            }
            let of = |k: usize| order.iter().map(move |named| named[k] as usize);
            let positions: Vec<[f32; 3]> = of(0).map(|own| parts.positions[own]).collect();
            attributes.insert("POSITION".into(), json!(out.positions(&positions)));
            if normals {
                let own: Vec<f32> = of(1).flat_map(|own| parts.normals[own]).collect();
                attributes.insert("NORMAL".into(), json!(out.floats(&own, order.len(), "VEC3")));
            }
            if texcoords {
                let flip = |own: usize| [parts.texcoords[own][0], 1.0 - parts.texcoords[own][1]];
                let own: Vec<f32> = of(2).flat_map(flip).collect();
                attributes
                    .insert("TEXCOORD_0".into(), json!(out.floats(&own, order.len(), "VEC2")));
            }
        }
        let indices = out.indices(&corners);
        primitives
            .push(json!({"attributes": attributes, "indices": indices, "material": material}));
    }
    json!({"name": own.name, "primitives": primitives})
}

fn material(own: &Material) -> Value {
    let mut pbr = Map::new();
    let mut more = Map::new();
    let mut base = own.diffuse;
    let (mut metallic, mut roughness) = (0.0, 1.0);
    if let Some(glass) = &own.dielectric {
        base = glass.tint;
        roughness = own.roughness;
        more.insert("KHR_materials_transmission".into(), json!({"transmissionFactor": 1.0}));
        more.insert("KHR_materials_ior".into(), json!({"ior": glass.refractive_index}));
        if glass.refractive_index != 1.0 {
            more.insert("KHR_materials_volume".into(), json!({"thicknessFactor": 1.0}));
        }
    } else if own.is_mirror() {
        base = std::array::from_fn(|k| own.diffuse[k] + own.mirror[k]);
        metallic = own.mirror.iter().sum::<f32>() / base.iter().sum::<f32>();
        roughness = own.roughness;
    }
    let [red, green, blue] = base;
    pbr.insert("baseColorFactor".into(), json!([red, green, blue, 1.0]));
    pbr.insert("metallicFactor".into(), json!(metallic));
    pbr.insert("roughnessFactor".into(), json!(roughness));
    if let Some(texture) = own.texture {
        pbr.insert("baseColorTexture".into(), json!({"index": texture}));
    }
    let strength = own.emission.iter().fold(1.0f32, |most, part| most.max(*part));
    if strength > 1.0 {
        let strength = json!({"emissiveStrength": strength});
        more.insert("KHR_materials_emissive_strength".into(), strength);
    }
    let factor = own.emission.map(|part| part / strength);
    let mut made = json!({
        "name": own.name, "doubleSided": true, "emissiveFactor": factor, "pbrMetallicRoughness": pbr
    });
    if !more.is_empty() {
        made["extensions"] = Value::Object(more);
    }
    made
}

fn light_of(light: &Light) -> Option<(Value, DMat3, DVec3)> {
    let (kind, irradiance, squared, axes, origin) = match *light {
        Light::Point { position, irradiance, distance } => {
            let squared = f64::from(distance) * f64::from(distance);
            ("point", irradiance, squared, DMat3::IDENTITY, point(position))
        }
        Light::Directional { towards, irradiance } => {
            let z = point(towards).try_normalize()?;
            let (x, y) = z.any_orthonormal_pair();
            ("directional", irradiance, 1.0, DMat3::from_cols(x, y, z), DVec3::ZERO)
        }
        _ => return None,
    };
    let most = irradiance.iter().fold(f32::MIN_POSITIVE, |most, part| most.max(*part));
    let intensity = f64::from(most) * squared;
    let own =
        json!({"type": kind, "color": irradiance.map(|part| part / most), "intensity": intensity});
    Some((own, axes, origin))
}

fn point(own: [f32; 3]) -> DVec3 {
    DVec3::from_array(own.map(f64::from))
}

fn columns(axes: DMat3, origin: DVec3) -> Vec<f64> {
    let [x, y, z] = axes.to_cols_array_2d();
    let rows = [(x, 0.0), (y, 0.0), (z, 0.0), (origin.to_array(), 1.0)];
    rows.into_iter().flat_map(|([a, b, c], d)| [a, b, c, d]).collect()
}

fn png(texture: &Texture) -> Vec<u8> {
    let mut bytes = Vec::new();
    let texels = texture.texels().as_flattened();
    let (width, height) = (texture.width(), texture.height());
    let written =
        PngEncoder::new(&mut bytes).write_image(texels, width, height, ExtendedColorType::Rgba8);
    // Memory takes all bytes, and a texture has as many texels as its sides say.
    debug_assert!(written.is_ok());
    bytes
}

/// The bytes, and what lies where in them.
#[derive(Default)]
struct Out {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Out {
    fn view(&mut self, bytes: &[u8], align: usize) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(align), 0);
        let start = self.bytes.len();
        self.bytes.extend(bytes);
        let length = bytes.len();
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": length}));
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats(&mut self, values: &[f32], count: usize, kind: &str) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let view = self.view(&bytes, 4);
        self.accessor(
            json!({"bufferView": view, "componentType": FLOAT, "count": count, "type": kind}),
        )
    }

    fn positions(&mut self, values: &[[f32; 3]]) -> usize {
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for (axis, value) in values.iter().flat_map(|value| value.iter().copied().enumerate()) {
            if value.is_finite() {
                bounds[0][axis] = bounds[0][axis].min(value);
                bounds[1][axis] = bounds[1][axis].max(value);
            }
        }
        let [least, most] = bounds.map(|own| own.map(|x| if x.is_finite() { x } else { 0.0 }));
        let index = self.floats(values.as_flattened(), values.len(), "VEC3");
        (self.accessors[index]["min"], self.accessors[index]["max"]) = (json!(least), json!(most));
        index
    }

    fn times(&mut self, values: &[f32]) -> usize {
        let index = self.floats(values, values.len(), "SCALAR");
        let (first, last) = (values.first(), values.last());
        (self.accessors[index]["min"], self.accessors[index]["max"]) =
            (json!([first]), json!([last]));
        index
    }

    fn indices(&mut self, corners: &[u32]) -> usize {
        let bytes: Vec<u8> = corners.iter().flat_map(|corner| corner.to_le_bytes()).collect();
        let view = self.view(&bytes, 4);
        let count = corners.len();
        self.accessor(json!({"bufferView": view, "componentType": UNSIGNED, "count": count, "type": "SCALAR"}))
    }
}
