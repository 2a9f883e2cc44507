use super::*;
use crate::instanced::Pose;
use crate::{Light, builtin};
use base64::Engine;
use serde_json::{Value, json};
use splitplane_core::scene::Transform;
use std::path::PathBuf;

/// Numbers of a file, and where they are.
#[derive(Default)]
struct Numbers {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Numbers {
    fn add(&mut self, bytes: Vec<u8>, kind: u32, count: usize, of: &str) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend(bytes);
        self.views.push(view);
        let view = self.views.len() - 1;
        self.accessors
            .push(json!({"bufferView": view, "componentType": kind, "count": count, "type": of}));
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, rows: &[[f32; N]]) -> usize {
        let bytes = rows.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        let of = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        self.add(bytes, 5126, rows.len(), of)
    }

    fn shorts(&mut self, own: &[u16]) -> usize {
        self.add(own.iter().flat_map(|x| x.to_le_bytes()).collect(), 5123, own.len(), "SCALAR")
    }
}

fn picture() -> String {
    let mut bytes = Vec::new();
    let texels = [255u8, 0, 0, 255, 0, 255, 0, 255];
    use image::ImageEncoder;
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(&texels, 2, 1, image::ExtendedColorType::Rgba8)
        .unwrap();
    format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// A file with everything in it: a square of a strip and of indexed triangles, twice below a node that is turned by 90 degrees.
fn file() -> (Value, Vec<u8>) {
    let mut numbers = Numbers::default();
    let square = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [2.0, 3.0, 0.0]];
    let positions = numbers.floats(&square);
    let normals = numbers.floats(&[[0.0, 0.0, 2.0f32]; 4]);
    let texcoords = numbers.floats(&[[0.0f32, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
    let indices = numbers.shorts(&[0, 1, 3, 0, 3, 2]);
    let strip = numbers.shorts(&[0, 1, 2, 3]);
    let times = numbers.floats(&[[0.0f32], [1.0]]);
    let moves = numbers.floats(&[[0.0f32, 0.0, 0.0], [24.0, 0.0, 0.0]]);
    let half = 0.5f32.sqrt();
    let Numbers { bytes, views, accessors } = numbers;
    let root = json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform", "KHR_materials_clearcoat"],
        "extensions": {"KHR_lights_punctual": {"lights": [
            {"type": "directional", "intensity": 2.0, "color": [1.0, 0.5, 0.25]},
            {"type": "spot", "intensity": 5.0, "spot": {}}
        ]}},
        "buffers": [{"byteLength": bytes.len()}],
        "bufferViews": views,
        "accessors": accessors,
        "images": [{"uri": picture()}],
        "textures": [{"source": 0}],
        "materials": [
            {"name": "painted", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1.0, 1.0], "metallicFactor": 0.0,
                "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0.0], "scale": [2.0, 1.0]}}}},
                "normalTexture": {"index": 0}},
            {"name": "steel", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "roughnessFactor": 0.2},
                "emissiveFactor": [0.0, 1.0, 0.0], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}}}
        ],
        "meshes": [
            {"name": "square", "primitives": [
                {"attributes": {"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": texcoords, "_OWN": texcoords}, "indices": indices, "material": 0},
                {"attributes": {"POSITION": positions}, "indices": strip, "mode": 5, "material": 1},
                {"attributes": {"POSITION": positions}, "mode": 0}
            ]}
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 2, "path": "translation"}}],
            "samplers": [{"input": times, "output": moves}]}],
        "nodes": [
            {"rotation": [0.0, 0.0, half, half], "translation": [10.0, 0.0, 0.0], "children": [1, 2, 3], "extras": "any"},
            {"mesh": 0, "matrix": [1.0,0.0,0.0,0.0, 0.0,1.0,0.0,0.0, 0.0,0.0,-1.0,0.0, 0.0,0.0,5.0,1.0]},
            {"mesh": 0, "scale": [2.0, 2.0, 2.0]},
            {"camera": 0, "translation": [0.0, 0.0, 4.0]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"translation": [1.0, 2.0, 3.0], "extensions": {"KHR_lights_punctual": {"light": 1}}},
            {"mesh": 0, "scale": [0.0, 0.0, 0.0]}
        ],
        "scenes": [{"nodes": [0, 4, 5, 6]}]
    });
    (root, bytes)
}

fn text(root: &Value, bytes: &[u8]) -> String {
    let mut root = root.clone();
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    root["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
    root.to_string()
}

fn glb(root: &Value, bytes: &[u8]) -> Vec<u8> {
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF".to_vec();
    let length = 12 + 8 + json.len() + 8 + bytes.len();
    out.extend([2, length as u32, json.len() as u32].map(u32::to_le_bytes).as_flattened());
    out.extend(b"JSON");
    out.extend(&json);
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bytes);
    out
}

fn path() -> PathBuf {
    PathBuf::from("some.gltf")
}

fn read_text(text: &str) -> Result<InstancedScene, MeshFileError> {
    parse(text.as_bytes(), &path(), &SceneOptions::default())
}

fn near(a: &Transform, b: [[f64; 4]; 3]) {
    for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
        assert!((f64::from(*a) - b).abs() < 1e-5, "{a} for {b}");
    }
}

#[test]
fn everything_in_a_file_becomes_ours_or_is_said() {
    let (root, bytes) = file();
    let mut scene = read_text(&text(&root, &bytes)).unwrap();
    let binary = parse(&glb(&root, &bytes), &path(), &SceneOptions::default()).unwrap();
    assert_eq!(scene, binary);
    let mut external = root.clone();
    external["buffers"][0]["uri"] = json!("of%20its/own.bin");
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("of its")).unwrap();
    std::fs::write(folder.path().join("of its/own.bin"), &bytes).unwrap();
    std::fs::write(folder.path().join("some.gltf"), external.to_string()).unwrap();
    assert_eq!(scene, read(&folder.path().join("some.gltf"), &SceneOptions::default()).unwrap());

    assert_eq!(scene.geometries.len(), 1);
    assert_eq!(scene.parts.indices, [[0, 1, 2], [0, 2, 3], [0, 1, 3], [3, 1, 2]]);
    assert_eq!(scene.parts.positions[3], [0.0, 3.0, 0.0]);
    assert_eq!(scene.parts.material_of, [0, 0, 1, 1]);
    assert_eq!(scene.parts.normals, [[0.0, 0.0, 1.0]; 4]);
    assert_eq!(scene.parts.normal_indices[2], [Scene::NONE; 3]);
    // Twice along, half a picture further, from below.
    assert_eq!(scene.parts.texcoords[..3], [[0.5, 1.0], [2.5, 1.0], [2.5, 0.0]]);
    let [painted, steel] = &scene.parts.materials[..] else { panic!() };
    assert_eq!((painted.diffuse, painted.texture), ([0.5, 0.25, 1.0], Some(0)));
    assert_eq!((steel.mirror, steel.diffuse, steel.roughness), ([0.8; 3], [0.0; 3], 0.2));
    assert_eq!(steel.emission, [0.0, 4.0, 0.0]);
    assert_eq!(scene.parts.textures[0].texels(), [[255, 0, 0, 255], [0, 255, 0, 255]]);
    let ids: Vec<u32> = scene.instances.iter().map(|own| own.id).collect();
    assert_eq!(ids, [1, 2]);
    let turned = [[0.0, -1.0, 0.0, 10.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 5.0]];
    near(&scene.instances[0].transform, turned);
    assert!(scene.instances[0].keys.is_empty());
    assert_eq!((scene.frames, scene.instances[1].keys.len()), (25, 25));
    let mut described = scene.describe().unwrap();
    scene.set(12, &mut described).unwrap();
    // Halfway along its parent's turned first axis.
    let moved = [[0.0, -2.0, 0.0, 10.0], [2.0, 0.0, 0.0, 12.0], [0.0, 0.0, 2.0, 0.0]];
    near(&scene.instances[1].transform, moved);
    let camera = scene.parts.camera.unwrap();
    assert_eq!(camera.eye(), [10.0, 0.0, 4.0]);
    assert!((camera.fov_degrees() - 57.29578).abs() < 1e-4);
    assert_eq!(
        scene.parts.lights,
        [
            Light::Directional { towards: [0.0, 0.0, 1.0], irradiance: [2.0, 1.0, 0.5] },
            Light::Point { position: [1.0, 2.0, 3.0], irradiance: [5.0; 3], distance: 1.0 },
        ]
    );
    let notes = scene.parts.notes.sentences().join("\n");
    for words in [
        "KHR_materials_clearcoat",
        "1 points, lines",
        "texture of normals",
        "1 nodes are left",
        "1 spot lights",
    ] {
        assert!(notes.contains(words), "{words}: {notes}");
    }
    assert!(!notes.contains("KHR_texture_transform"));
}

#[test]
fn flattened_triangles_are_where_the_instances_are() {
    let (root, bytes) = file();
    let flat = {
        let scene = read_text(&text(&root, &bytes)).unwrap();
        assert!(scene.clone().flatten(500).unwrap_err().is_limit());
        scene.flatten(1 << 20).unwrap()
    };
    assert_eq!(flat.indices.len(), 8);
    // The first one is reflected: its corners run the other way around.
    let want = [[10.0, 0.0, 5.0], [7.0, 2.0, 5.0], [10.0, 2.0, 5.0]];
    for (corner, want) in flat.corners(0).unwrap().as_flattened().iter().zip(want.as_flattened()) {
        assert!((corner - want).abs() < 1e-5, "{corner} for {want}");
    }
    assert_eq!(flat.normals[0], [0.0, 0.0, -1.0]);
    assert_eq!(flat.material_of, [0, 0, 1, 1, 0, 0, 1, 1]);
    assert!(flat.mesh().is_ok());
}

#[test]
fn errors_name_the_field() {
    let (good, bytes) = file();
    let cases: [(&str, Value, &str, &str); 26] = [
        ("/asset/version", json!("1.0"), "asset.version: ", "1.0"),
        (
            "/extensionsRequired",
            json!(["KHR_draco_mesh_compression"]),
            "extensionsRequired[0]: ",
            "draco",
        ),
        ("/buffers/0/byteLength", json!(4294967295u32), "buffers[0].byteLength: ", "4294967295"),
        (
            "/bufferViews/0/byteLength",
            json!(4294967295u32),
            "bufferViews[0].byteLength: ",
            "4294967295",
        ),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "bufferViews[0].byteLength: ", "room for 0"),
        ("/bufferViews/3/buffer", json!(9), "bufferViews[3].buffer: ", "not there"),
        ("/accessors/0/count", json!(4294967295u32), "accessors[0].count: ", "64 times its bytes"),
        ("/accessors/0/count", json!(10000), "accessors[0].count: ", "10000 elements"),
        (
            "/meshes/0/primitives/1/attributes/POSITION",
            json!(4294967295u32),
            "meshes[0].primitives[1].attributes: ",
            "not there",
        ),
        ("/accessors/0/count", json!(u64::MAX), "accessors[0].count: ", "64 times its bytes"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "accessors[0].count: ", "room for 0"),
        ("/accessors/0/type", json!("VEC2"), "accessors[0].type: ", "Vec3"),
        ("/accessors/3/componentType", json!(5126), "accessors[3].componentType: ", "whole"),
        (
            "/accessors/1/count",
            json!(3),
            "meshes[0].primitives[0].attributes.NORMAL: ",
            "3 elements",
        ),
        (
            "/accessors/0/count",
            json!(3),
            "meshes[0].primitives[0].indices: ",
            "vertex 3 is named, but there are 3",
        ),
        ("/nodes/0/children", json!([1, 2, 3, 0]), "nodes[0]: ", "child of two"),
        ("/nodes/4/children", json!([1]), "nodes[1]: ", "child of two"),
        ("/nodes/0/children", json!([1, 99]), "nodes[0].children[1]: ", "not there"),
        ("/nodes/0/rotation", json!([0.0, 0.0, 0.0, 0.0]), "nodes[0].rotation: ", "zero"),
        ("/nodes/2/translation", json!([0.0, 1e39, 0.0]), "nodes[2].translation", "finite"),
        ("/nodes/1/mesh", json!("0"), "nodes[1].mesh: ", "invalid type"),
        ("/accessors/6/count", json!(1), "animations[0].channels[0]: ", "do not fit"),
        (
            "/animations/0/channels/0/target/node",
            json!(99),
            "animations[0].channels[0].target.node: ",
            "not there",
        ),
        ("/animations/0/samplers/0/input", json!(99), "", "not there"),
        ("/animations/0/channels/0/sampler", json!(7), "animations[0].channels[0]", "not there"),
        ("/scenes/0/nodes", json!([4]), "some.gltf`: ", "no triangles"),
    ];
    for (pointer, value, place, words) in cases {
        let mut root = good.clone();
        match root.pointer_mut(pointer) {
            Some(field) => *field = value.clone(),
            None => {
                let (parent, name) = pointer.rsplit_once('/').unwrap();
                root.pointer_mut(parent).unwrap()[name] = value.clone();
            }
        }
        let error = read_text(&text(&root, &bytes)).expect_err(pointer).to_string();
        assert!(error.contains(place) && error.contains(words), "{pointer} {value}: {error}");
    }
    for (uri, words) in
        [("../secret.bin", "leads out"), ("data:,x", "base64"), ("none.bin", "no such file")]
    {
        let mut root = good.clone();
        root["buffers"][0]["uri"] = json!(uri);
        let error = read_text(&root.to_string()).expect_err(uri).to_string();
        assert!(error.contains("buffers[0].uri: ") && error.contains(words), "{error}");
    }
    let good = glb(&good, &bytes);
    for (at, value, words) in [
        (4, 1u32, "byte 4: version 1"),
        (8, 3, "byte 8: "),
        (8, u32::MAX, "byte 8: it announces 4294967295 bytes"),
        (12, u32::MAX, "byte 12: it announces 4294967295 bytes of a chunk"),
        (16, 0, "byte 12: the file has no chunk of JSON"),
    ] {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let error = parse(&bytes, &path(), &SceneOptions::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
}

/// A few bytes that mean many: none of them makes more memory than is announced by a file's length.
#[test]
fn small_files_stay_small() {
    let zeros = |count: u64| {
        json!({"asset": {"version": "2.0"}, "accessors": [{"componentType": 5126, "count": count, "type": "VEC3"}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}]})
    };
    let error = read_text(&zeros(1 << 23).to_string()).unwrap_err().to_string();
    assert!(error.contains("accessors[0].count"), "{error}");
    assert_eq!(read_text(&zeros(30).to_string()).unwrap().parts.indices.len(), 10);
    // Many meshes that share one accessor.
    let mut root = zeros(0);
    root["buffers"] = json!([{"byteLength": 36000}]);
    root["bufferViews"] = json!([{"buffer": 0, "byteLength": 36000}]);
    root["accessors"][0] =
        json!({"bufferView": 0, "componentType": 5126, "count": 3000, "type": "VEC3"});
    let mesh = root["meshes"][0].clone();
    root["meshes"] = json!(vec![mesh; 5000]);
    let nodes: Vec<Value> = (0..5000).map(|own| json!({"mesh": own})).collect();
    root["nodes"] = json!(nodes);
    let error = read_text(&text(&root, &vec![0; 36000])).unwrap_err().to_string();
    assert!(error.contains("64 times its bytes"), "{error}");
    // Nodes in a line, and JSON in a line.
    let mut deep = zeros(3);
    let nodes: Vec<Value> = (0..100_000)
        .map(|own| if own < 99_999 { json!({"children": [own + 1]}) } else { json!({"mesh": 0}) })
        .collect();
    (deep["nodes"], deep["scenes"]) = (json!(nodes), json!([{"nodes": [0]}]));
    assert_eq!(read_text(&deep.to_string()).unwrap().instances.len(), 1);
    let nested = format!("{{\"asset\":{}", "[".repeat(200_000));
    assert!(read_text(&nested).is_err());
    let objects = format!("{{\"nodes\":[{}", "{},".repeat(MOST_OBJECTS));
    assert!(read_text(&objects).unwrap_err().problem.is_limit());
}

#[test]
fn no_bytes_do_anything_but_be_read_or_refused() {
    let (root, bytes) = file();
    let good = text(&root, &bytes);
    let binary = glb(&root, &bytes);
    let (mut refused, mut read_in) = (0, 0);
    let mut check = |bytes: &[u8]| match parse(bytes, &path(), &SceneOptions::default()) {
        Ok(mut scene) => {
            let mut described = scene.describe().unwrap();
            for frame in [0, scene.frames - 1] {
                scene.set(frame, &mut described).unwrap();
            }
            assert!(scene.flatten(1 << 24).unwrap().mesh().is_ok());
            read_in += 1;
        }
        Err(error) => {
            let error = error.to_string();
            assert!(!error.contains('\n') && error.len() < 1500, "{error}");
            refused += 1;
        }
    };
    // The picture and the numbers are most of the text: of those only some bytes.
    let odd = |at: &usize| at.is_multiple_of(7) || !good.as_bytes()[*at].is_ascii_alphanumeric();
    for at in (0..good.len()).filter(odd) {
        check(&good.as_bytes()[..at]);
        for other in *b"9-e\"[},\x07" {
            let mut bytes = good.clone().into_bytes();
            bytes[at] = other;
            check(&bytes);
        }
    }
    for at in (0..binary.len()).step_by(3) {
        check(&binary[..at]);
        for other in [0, 0xff] {
            let mut bytes = binary.clone();
            let end = bytes.len().min(at + 4);
            bytes[at..end].fill(other);
            check(&bytes);
        }
    }
    // Every number of the JSON as something else.
    let starts: Vec<usize> = (1..good.len())
        .filter(|at| {
            let bytes = good.as_bytes();
            bytes[*at].is_ascii_digit() && matches!(bytes[at - 1], b':' | b'[' | b',')
        })
        .collect();
    for start in starts {
        let length = good[start..].find([',', ']', '}']).unwrap();
        for other in
            ["4294967295", "18446744073709551615", "-1", "1e39", "null", "[]", "0", "1e-30"]
        {
            check((good[..start].to_owned() + other + &good[start + length..]).as_bytes());
        }
    }
    assert!(refused > 5000 && read_in > 500, "{refused} {read_in}");
}

#[test]
fn what_is_written_is_read_again() {
    let (root, bytes) = file();
    for scene in [
        read_text(&text(&root, &bytes)).unwrap(),
        builtin::open_instanced("flock:30").unwrap(),
        Scene::open("builtin:spheres").unwrap().into(),
    ] {
        let written = to_glb(&scene).unwrap();
        let again = parse(&written, Path::new("again.glb"), &SceneOptions::default()).unwrap();
        assert_eq!(again.instances.len(), scene.instances.len(), "{}", scene.name);
        assert_eq!(again.parts.lights.len(), scene.parts.lights.len());
        assert_eq!(again.parts.camera.is_some(), scene.parts.camera.is_some());
        // Frames of the file are 24 a second; keys are where they were.
        let moving = |scene: &InstancedScene| {
            scene.instances.iter().filter(|own| !own.keys.is_empty()).count()
        };
        let sorted = |scene: &InstancedScene| {
            let flat = scene.clone().flatten(1 << 30).unwrap();
            let mut all: Vec<[[u32; 3]; 3]> =
                flat.triangles().map(|own| own.map(|corner| corner.map(f32::to_bits))).collect();
            all.sort_unstable();
            all
        };
        // Places of what moves are computed again from a turn and scales.
        if moving(&scene) == 0 {
            assert!(sorted(&again) == sorted(&scene), "{}", scene.name);
        }
        let own = |scene: &InstancedScene| {
            let mut all: Vec<[u32; 3]> =
                scene.parts.positions.iter().map(|own| own.map(f32::to_bits)).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        assert!(own(&again) == own(&scene), "{}", scene.name);
        let looks = |scene: &InstancedScene| {
            let of = |own: &crate::Material| (own.name.clone(), own.dielectric, own.texture);
            scene.parts.materials.iter().map(of).collect::<Vec<_>>()
        };
        assert_eq!(looks(&again), looks(&scene));
        assert_eq!(again.parts.textures.len(), scene.parts.textures.len());
        assert_eq!(moving(&again), moving(&scene));
    }
}

/// A rotation, a scale and a cubic spline; a parent that scales unevenly leaves its turning child where it is.
#[test]
fn poses_between_keys() {
    let (mut root, mut bytes) = file();
    let half = 0.5f32.sqrt();
    let mut add = |rows: &[f32], count: usize, of: &str| {
        let start = bytes.len();
        bytes.extend(rows.iter().flat_map(|x| x.to_le_bytes()));
        let views = root["bufferViews"].as_array_mut().unwrap();
        views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": rows.len() * 4}));
        let view = views.len() - 1;
        let accessors = root["accessors"].as_array_mut().unwrap();
        accessors
            .push(json!({"bufferView": view, "componentType": 5126, "count": count, "type": of}));
        accessors.len() - 1
    };
    let turns = add(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -half, -half], 2, "VEC4");
    let spline =
        add(&[[0.0; 3], [1.0; 3], [0.0; 3], [0.0; 3], [3.0; 3], [0.0; 3]].concat(), 6, "VEC3");
    root["buffers"][0]["byteLength"] = json!(bytes.len());
    root["animations"][0] = json!({
        "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}, {"sampler": 1, "target": {"node": 2, "path": "scale"}}],
        "samplers": [{"input": 5, "output": turns}, {"input": 5, "output": spline, "interpolation": "CUBICSPLINE"}]
    });
    root["nodes"][0] = json!({"children": [1, 2, 3]});
    let scene = read_text(&text(&root, &bytes)).unwrap();
    let keys = &scene.instances[1].keys;
    assert_eq!(keys.len(), 25);
    let eighth = Pose::rotation([0.0, 0.0, 1.0], 45.0).unwrap();
    let middle = &keys[12].pose;
    for k in 0..4 {
        assert!((middle.rotate[k].abs() - eighth[k].abs()).abs() < 1e-6, "{middle:?}");
    }
    assert!((middle.scale[0] - 2.0).abs() < 1e-6, "{middle:?}");
    root["nodes"][0]["scale"] = json!([1.0, 5.0, 1.0]);
    let scene = read_text(&text(&root, &bytes)).unwrap();
    assert!(scene.instances[1].keys.is_empty());
    assert!(scene.parts.notes.sentences().join("\n").contains("1 instances stand still"));
}
