//! Good files, and files that are broken in every place.

use super::*;
use crate::instanced::{InstancedScene, SolidKind, Solids};
use splitplane_core::scene::{GeometryId, InstanceId, translation};
use splitplane_render::layout::FirstHit;

const GOOD: &str = r#"{
  "format": "splitplane-scene", "version": 1, "frames": 5, "seconds_per_frame": 0.5,
  "materials": [
    {"name": "red", "diffuse": [0.7, 0.1, 0.1], "mirror": [0.1, 0.1, 0.1], "roughness": 0.25},
    {"name": "glass", "glass": {"index": 1.5, "tint": [1, 0.9, 0.9]}},
    {"name": "lamp", "emission": [3, 2, 1]}
  ],
  "geometries": [
    {"name": "one", "positions": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,2]], "material": "red"},
    {"name": "left", "obj": "two.obj", "group": "left"},
    {"name": "again", "obj": "two.obj", "group": "left"},
    {"name": "all", "obj": "two.obj", "material": "lamp"},
    {"name": "cube", "obj": "two.obj", "object": "cube"}
  ],
  "instances": [
    {"geometry": "one", "transform": [1,0,0,4, 0,1,0,5, 0,0,1,6], "mask": 3, "id": 7, "culling": "back"},
    {"geometry": "left", "translate": [1, 2, 3], "scale": [2, 2, -2], "material": "glass"},
    {"geometry": "again", "rotate": {"axis": [0, 1, 0], "degrees": 90}, "scale": 2},
    {"geometry": "cube", "keys": [{"frame": 1, "translate": [0, 1, 0]}, {"frame": 3, "translate": [0, 3, 0]}]}
  ],
  "cameras": [{"eye": [0, 0, 9], "at": [0, 0, 0], "fov_degrees": 30}],
  "lights": [
    {"point": {"position": [1, 2, 3], "irradiance": [1, 1, 1], "distance": 4}},
    {"sun": {"towards": [0, 1, 0], "irradiance": [1, 1, 1]}}
  ]
}"#;

const TWO: &str = "o plate\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng left\nf 1 2 3\no cube\ng right far\nf 1 3 4\nf 1 2 4\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("two.obj"), TWO).unwrap();
    folder
}

fn read_in(folder: &tempfile::TempDir, text: &str) -> Result<InstancedScene, SceneFileError> {
    parse(text, &folder.path().join("scene.json"), &SceneOptions::default())
}

#[test]
fn a_file_says_what_is_where() {
    let folder = folder();
    let mut scene = read_in(&folder, GOOD).unwrap();
    assert_eq!((scene.frames, scene.seconds_per_frame), (5, 0.5));
    // The same group of the same file is one geometry.
    let parts: Vec<_> =
        scene.geometries.iter().map(|g| (g.triangles.len(), g.vertices.len())).collect();
    assert_eq!(parts, [(1, 3), (1, 3), (3, 4), (2, 4)]);
    let [one, left, again, cube] = &scene.instances[..] else { panic!("{:?}", scene.instances) };
    assert_eq!((one.transform, one.mask, one.id), (translation([4.0, 5.0, 6.0]), 3, 7));
    assert_eq!((left.geometry, left.material), (again.geometry, Some(1)));
    assert_eq!(left.transform[2], [0.0, 0.0, -2.0, 3.0]);
    assert_eq!((cube.geometry, cube.keys.len(), cube.transform[1][3]), (3, 2, 1.0));
    assert_eq!(scene.parts.corners(1), Some([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    assert_eq!(scene.parts.corners(6), Some([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]));
    // The material of a geometry takes the place of what its file says.
    assert_eq!(scene.parts.material_of[2..5], [2; 3]);
    assert!([1, 5].iter().all(|triangle: &usize| scene.parts.material_of[*triangle] > 2));
    assert_eq!(scene.parts.lights.len(), 2);
    assert!(scene.parts.materials[1].dielectric.is_some() && scene.parts.materials[2].shines());
    assert_eq!([0, 1, 2].map(|index| scene.parts.materials[index].roughness), [0.25, 0.0, 0.0]);
    let mut described = scene.describe().unwrap();
    assert_eq!(scene.set(2, &mut described), Ok(1));
    assert_eq!(scene.instances[3].transform, translation([0.0, 2.0, 0.0]));
    assert_eq!(scene.set(4, &mut described), Ok(1));
    assert_eq!(scene.instances[3].transform, translation([0.0, 3.0, 0.0]));
}

const SHAPES: &str = r#"{
  "format": "splitplane-scene", "version": 1, "frames": 3,
  "materials": [{"name": "red", "diffuse": [0.7, 0.1, 0.1]}, {"name": "glass", "glass": {"index": 1.5}}],
  "geometries": [
    {"name": "balls", "spheres": [{"centre": [0, 1, 2], "radius": 0.5}, {"centre": [3, 0, 0], "radius": 2}], "material": "red"},
    {"name": "rods", "capsules": [{"ends": [[0, 0, 0], [0, 2, 0]], "radius": 0.25}]}
  ],
  "instances": [
    {"geometry": "balls", "translate": [1, 0, 0], "scale": [1, 2, 1]},
    {"geometry": "rods", "material": "glass"},
    {"geometry": "rods", "keys": [{"frame": 0}, {"frame": 2, "translate": [0, 4, 0]}]}
  ]
}"#;

#[test]
fn spheres_and_capsules_have_materials_and_keys() {
    use splitplane_core::scene::shape::{Capsule, Sphere};
    let folder = folder();
    let mut scene = read_in(&folder, SHAPES).unwrap();
    let [balls, rods] = &scene.geometries[..] else { panic!("{:?}", scene.geometries) };
    let ball = |centre, radius| Sphere { centre, radius };
    let both = vec![ball([0.0, 1.0, 2.0], 0.5), ball([3.0, 0.0, 0.0], 2.0)];
    let solids = |geometry: &crate::instanced::Geometry| geometry.solids.clone().unwrap();
    assert_eq!(solids(balls), Solids { kind: SolidKind::Spheres(both), material: 0 });
    let rod = Capsule { ends: [[0.0; 3], [0.0, 2.0, 0.0]], radius: 0.25 };
    assert_eq!(solids(rods).kind, SolidKind::Capsules(vec![rod]));
    assert_eq!(scene.solids(), 3);
    // An instance's own material, or that of its shapes; grey where there is none.
    let (_, materials) = scene.numbers();
    assert_eq!(materials, [0, 1, 2]);
    assert_eq!(scene.parts.materials[2], Material::clay());
    let mut described = scene.describe().unwrap();
    assert_eq!(described.geometries().filter(|(_, mesh)| mesh.shapes().is_some()).count(), 2);
    assert_eq!(scene.set(1, &mut described), Ok(1));
    assert_eq!(scene.instances[2].transform, translation([0.0, 2.0, 0.0]));
    // A camera from outside sees them.
    let eye = scene.placement(1.0, 1).camera.eye();
    assert!(eye.iter().all(|x| x.is_finite()) && eye != [0.0; 3], "{eye:?}");
    let cases = [
        ("\"radius\": 0.5", "\"radius\": 0", "line 5, column", "geometries[0].spheres[0].radius: "),
        ("\"radius\": 0.5", "\"radius\": -1", "line 5, column", "at least 1e-37"),
        (
            "\"centre\": [3, 0, 0]",
            "\"centre\": [3, 0]",
            "line 5, column",
            "geometries[0].spheres[1]",
        ),
        ("\"centre\": [3, 0, 0]", "\"middle\": [3, 0, 0]", "unknown field `middle`", "line 5"),
        ("\"ends\": [[0, 0, 0], ", "\"ends\": [", "line 6, column", "geometries[1].capsules[0]"),
        ("\"capsules\"", "\"spheres\": [], \"capsules\"", "geometries[1].capsules: ", "not both"),
        (
            "\"capsules\"",
            "\"obj\": \"two.obj\", \"capsules\"",
            "geometries[1].name: ",
            "line 6, column 14",
        ),
        ("\"material\": \"red\"", "\"material\": \"blue\"", "geometries[0].material: ", "`blue`"),
    ];
    for (from, to, place, words) in cases {
        let text = SHAPES.replacen(from, to, 1);
        assert_ne!(text, SHAPES, "{from}");
        let error = read_in(&folder, &text).expect_err(to).to_string();
        assert!(error.contains(place) && error.contains(words), "{to}: {error}");
    }
}

/// A leaf whose picture is open in two quarters.
#[cfg(feature = "textures")]
#[test]
fn pictures_of_holes_become_masks() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let leaf = "mtllib leaf.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                g leaf\nusemtl leaf\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\ng stem\nusemtl stem\nf 1 2 3\n";
    std::fs::write(at("leaf.obj"), leaf).unwrap();
    let mtl = "newmtl leaf\nKd 0 1 0\nmap_d leaf.png\nnewmtl stem\nKd 1 0 0\n";
    std::fs::write(at("leaf.mtl"), mtl).unwrap();
    // Open in the upper left and the lower right quarter: by alpha, and by grey.
    let by_alpha = |x: u32, y: u32| [9, 9, 9, if (x < 4) == (y < 4) { 0 } else { 255 }];
    let by_grey = |x: u32, y: u32| if (x < 4) == (y < 4) { [20, 20, 20, 255] } else { [255; 4] };
    let text = |more: &str| {
        format!(
            r#"{{"format": "splitplane-scene", "version": 1, "instances": [{{"geometry": "leaf"}}], "geometries": [
            {{"name": "leaf", "obj": "leaf.obj", "group": "leaf"{more}}}, {{"name": "stem", "obj": "leaf.obj", "group": "stem"}},
            {{"name": "all", "obj": "leaf.obj"}}], "materials": [{{"name": "red"}}]}}"#
        )
    };
    for grey in [false, true] {
        let picture = image::RgbaImage::from_fn(8, 8, |x, y| {
            image::Rgba(if grey { by_grey(x, y) } else { by_alpha(x, y) })
        });
        picture.save(at("leaf.png")).unwrap();
        let scene = read_in(&folder, &text("")).unwrap();
        let mask = |geometry: usize| scene.geometries[geometry].opacity.as_ref();
        assert!(mask(1).is_none());
        for geometry in [0, 2] {
            let mask = mask(geometry).unwrap();
            assert_eq!((mask.level(), mask.triangles()), (3, [2, 0, 3][geometry]));
            let (mut open, mut closed) = (0, 0);
            for i in 0..40 {
                for j in 0..40 {
                    // Not on a border of cells.
                    let [x, y] = [i, j].map(|k| (k as f32 + 0.5) / 40.0);
                    if (x - y).abs() < 0.15 || (x - 0.5).abs() < 0.15 || (y - 0.5).abs() < 0.15 {
                        continue;
                    }
                    // Corners of the first triangle are (0,0), (1,0), (1,1), those of the second (0,0), (1,1), (0,1).
                    let (triangle, u, v) = if x > y { (0, x - y, y) } else { (1, x, y - x) };
                    let opaque = mask.is_opaque(triangle, u, v);
                    assert_eq!(opaque, (x < 0.5) == (y < 0.5), "{geometry} {x} {y}");
                    if opaque { closed += 1 } else { open += 1 }
                }
            }
            assert!(open > 100 && closed > 100, "{open} {closed}");
        }
        assert!(mask(2).unwrap().is_opaque(2, 0.3, 0.3), "a stem has no holes");
        assert!(scene.describe().unwrap().opacity(GeometryId(0)).unwrap().is_some());
        // A material of the geometry's own has no holes.
        let painted = read_in(&folder, &text(", \"material\": \"red\"")).unwrap();
        assert!(painted.geometries[0].opacity.is_none());
        assert!(painted.geometries[2].opacity.is_some());
    }
    // What cannot be read is left out, with a note; one mesh does not read it.
    std::fs::write(at("leaf.png"), b"none").unwrap();
    let scene = read_in(&folder, &text("")).unwrap();
    assert!(scene.geometries.iter().all(|own| own.opacity.is_none()));
    assert!(scene.parts.notes.sentences().iter().any(|note| note.contains("leaf.png")));
    let one = crate::obj::read_with(&at("leaf.obj"), &SceneOptions::default()).unwrap();
    assert!(one.cutouts.is_empty() && one.notes.sentences().is_empty());
}

/// What is found for all groups at once is what is found for each.
#[test]
fn groups_are_found_by_all_their_names() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\ng a b\nf 1 2 3\no a\nf 1 2 3\ng b b c\nf 1 2 3\ng\nf 1 2 3\no x y\nf 1 2 3\ng c\ng a\nf 1 2 3\ng a b\nf 1 2 3\n";
    let folder = folder();
    let path = folder.path().join("many.obj");
    std::fs::write(&path, text).unwrap();
    let scene = crate::obj::read_with(&path, &SceneOptions::default()).unwrap();
    let all = scene.triangles_by_group();
    let names = ["a", "b", "c", "a b", "b b c", "x", "y", "x y", "default", "", "none"];
    let mut found = 0;
    for is_object in [false, true] {
        for name in names {
            let runs = all.get(&(is_object, name)).cloned().unwrap_or_default();
            assert_eq!(runs, scene.triangles_of(is_object, name), "{is_object} {name}");
            found += runs.len();
        }
    }
    assert!(found > 8, "{found}");
    assert!(all.keys().all(|(_, name)| names.contains(name)), "{:?}", all.keys());
}

/// What is built and saved can be looked at: the same geometries and instances, in grey.
#[test]
fn saved_scenes_are_read_as_they_were_built() {
    use splitplane_core::backend::BuildOptions;
    use splitplane_core::backend::scene::{HostScene, SceneAccelerator, write_file};
    let folder = folder();
    let scene = read_in(&folder, SHAPES).unwrap();
    let build = &mut |_: &splitplane_core::mesh::Mesh<'_>, _: &BuildOptions<'_>| unreachable!();
    let built = HostScene::build(&scene.describe().unwrap(), &BuildOptions::default(), build);
    let path = folder.path().join("saved.scene");
    std::fs::write(&path, write_file(built.unwrap().scene()).unwrap()).unwrap();
    let again = InstancedScene::open(&path).unwrap();
    let of = |scene: &InstancedScene| -> Vec<_> {
        scene.geometries.iter().map(|own| own.solids.clone().unwrap().kind).collect()
    };
    assert_eq!(of(&again), of(&scene));
    let at = |scene: &InstancedScene| -> Vec<_> {
        scene.instances.iter().map(|own| (own.geometry, own.transform)).collect()
    };
    assert_eq!(at(&again), at(&scene));
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[70] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let error = InstancedScene::open(&path).unwrap_err().to_string();
    assert!(error.contains("saved.scene") && error.contains("checksum"), "{error}");
    std::fs::remove_file(&path).unwrap();
    assert!(InstancedScene::open(&path).unwrap_err().to_string().contains("no such file"));
}

/// Each change with the place and the words of its error.
#[test]
fn what_is_wrong_is_named_with_its_place() {
    let folder = folder();
    let cases = [
        ("\"version\": 1", "\"version\": 2", "line 2, column 44, version: ", "version 2"),
        ("\"frames\": 5", "\"frames\": 0", "frames", "from 1 to"),
        ("\"mask\": 3", "\"mask\": -3", "line 16, column", "instances[0].mask: "),
        ("\"mask\": 3", "\"colour\": 3", "instances[0].colour: unknown field `colour`", "expected"),
        ("[0.7, 0.1, 0.1]", "[0.7, 1.1, 0.1]", "materials[0].diffuse: ", "from 0 to 1"),
        ("ness\": 0.25", "ness\": 1.25", "materials[0].roughness: ", "from 0 to 1"),
        (
            ", \"mirror\": [0.1, 0.1, 0.1]",
            "",
            "materials[0].roughness: ",
            "only mirrors and clear bodies",
        ),
        ("[1,0,0,4,", "[1,0,0,1e300,", "instances[0].transform: ", "finite"),
        (
            "{\"geometry\": \"one\"",
            "{\"geometry\": \"none\"",
            "line 16, column 18, instances[0].geometry: ",
            "there is no geometry `none`",
        ),
        (
            "\"material\": \"glass\"",
            "\"material\": \"gas\"",
            "instances[1].material: ",
            "no material `gas`",
        ),
        (
            "\"scale\": [2, 2, -2]",
            "\"scale\": [2, 0, 2]",
            "line 17, column 5, instances[1]: ",
            "no inverse",
        ),
        ("\"scale\": 2}", "\"scale\": \"2\"}", "instances[2].scale: ", "a number or three"),
        ("[0, 1, 0], \"degrees\"", "[0, 0, 0], \"degrees\"", "instances[2].rotate: ", "axis"),
        ("\"frame\": 3", "\"frame\": 1", "instances[3].keys[1]: ", "ascending"),
        ("\"frame\": 3", "\"frame\": 5", "instances[3].keys[1]: ", "counted from 0"),
        ("\"name\": \"again\"", "\"name\": \"left\"", "geometries[2].name: ", "another geometry"),
        (
            "\"object\": \"cube\"",
            "\"object\": \"left\"",
            "geometries[4].object: ",
            "no object `left`",
        ),
        ("[[0,1,2]]", "[[0,1,3]]", "geometries[0].triangles: ", ""),
        (
            "\"obj\": \"two.obj\", \"mat",
            "\"obj\": \"no.obj\", \"mat",
            "geometries[3].obj: ",
            "no such file",
        ),
        ("\"at\": [0, 0, 0]", "\"at\": [0, 0, 9]", "line 21, column 15, cameras[0]: ", "the same"),
        ("\"towards\": [0, 1, 0]", "\"towards\": [0, 0, 0]", "lights[1].sun.towards: ", "zero"),
        ("\"distance\": 4", "\"distance\": 0", "lights[0].point.distance: ", "more than 0"),
        (
            "\"mirror\": [0.1, 0.1, 0.1]",
            "\"glass\": {\"index\": 2}",
            "materials[0].glass: ",
            "leave",
        ),
    ];
    for (from, to, place, words) in cases {
        let text = GOOD.replacen(from, to, 1);
        assert_ne!(text, GOOD, "{from}");
        let error = read_in(&folder, &text).expect_err(to).to_string();
        assert!(error.contains(place) && error.contains(words), "{to}: {error}");
    }
}

/// Texts that are cut off, lack a byte, or have another one: a scene or a message of one line, and never anything else.
#[test]
fn no_text_does_anything_but_be_read_or_refused() {
    let folder = folder();
    let mut refused = 0;
    let mut check = |text: &str| {
        if let Err(error) = read_in(&folder, text) {
            let message = error.to_string();
            assert!(!message.contains('\n') && message.len() < 2000, "{message}");
            refused += 1;
        }
    };
    for at in 0..GOOD.len() {
        check(&GOOD[..at]);
        check(&[&GOOD[..at], &GOOD[at + 1..]].concat());
        for other in ["9", "-", "e", "\"", "[", "}", ",", "\u{7}"] {
            check(&[&GOOD[..at], other, &GOOD[at + 1..]].concat());
        }
    }
    check(&"[".repeat(100_000));
    check(&format!("{}{}", &GOOD[..GOOD.len() - 1], "{\"a\":".repeat(10_000)));
    assert!(refused > 8 * GOOD.len(), "{refused}");
}

#[test]
fn files_that_are_none_are_named() {
    let folder = folder();
    let options = SceneOptions { file_limit: Some(100), ..SceneOptions::default() };
    let path = folder.path().join("scene.json");
    let message = |options: &SceneOptions| read(&path, options).unwrap_err().to_string();
    assert!(message(&options).contains("no such file"));
    std::fs::write(&path, GOOD).unwrap();
    let error = read(&path, &options).unwrap_err();
    assert!(error.problem.is_limit(), "{error}");
    std::fs::write(&path, b"\xff\xfe").unwrap();
    assert!(message(&options).contains("not UTF-8"));
}

/// Instances of two names, one that is moved by keys, one that stays as it is, and one in a group of its own.
const BAKED: &str = r#"{
  "format": "splitplane-scene", "version": 1, "frames": 4,
  "materials": [{"name": "red", "diffuse": [0.7, 0.1, 0.1]}, {"name": "glass", "glass": {"index": 1.5}}],
  "geometries": [
    {"name": "one", "positions": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,2]], "material": "red"},
    {"name": "smooth", "obj": "smooth.obj"},
    {"name": "balls", "spheres": [{"centre": [0, 1, 0], "radius": 0.5}]}
  ],
  "instances": [
    {"geometry": "one"},
    {"geometry": "smooth", "bake": "rocks", "translate": [4, 0, 0], "rotate": {"axis": [0, 1, 0], "degrees": 90}, "id": 7},
    {"geometry": "one", "keys": [{"frame": 0}, {"frame": 3, "translate": [0, 3, 0]}]},
    {"geometry": "one", "bake": "rocks", "translate": [8, 0, 0], "scale": [-1, 2, 1], "id": 7},
    {"geometry": "smooth", "bake": "wall", "translate": [0, 0, 16]},
    {"geometry": "smooth", "bake": "rocks", "material": "red", "scale": 2, "id": 7},
    {"geometry": "balls"}
  ]
}"#;

const SMOOTH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 2\nvn 3 0 4\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1/1 2/2/2 3/3/1\nf 1 3 4\n";

#[test]
fn instances_of_a_name_become_one_geometry() {
    let folder = folder();
    std::fs::write(folder.path().join("smooth.obj"), SMOOTH).unwrap();
    let mut scene = read_in(&folder, BAKED).unwrap();
    let unbaked = SceneOptions { bake: false, ..SceneOptions::default() };
    let plain = parse(BAKED, &folder.path().join("scene.json"), &unbaked).unwrap();
    assert!(plain.baked.is_empty() && plain.instances.len() == scene.instances.len());
    // What is described is what the core bakes.
    let groups = [vec![1, 3, 5], vec![4]].map(|own| own.into_iter().map(InstanceId).collect());
    let [rocks, wall]: [Vec<InstanceId>; 2] = groups;
    let (world, table) = plain.describe().unwrap().bake(&[&rocks, &wall]).unwrap();
    let mut described = scene.describe().unwrap();
    let instances = |scene: &splitplane_core::scene::Scene| -> Vec<_> {
        scene.instances().map(|(name, own)| (name.0, *own)).collect()
    };
    assert_eq!(instances(&described), instances(&world));
    assert_eq!(described.instances().map(|(name, _)| name.0).collect::<Vec<_>>(), [0, 1, 2, 4, 6]);
    let names: Vec<u32> = world.geometries().map(|(name, _)| name.0).collect();
    assert_eq!(described.geometries().map(|(name, _)| name.0).collect::<Vec<_>>(), names);
    for name in names {
        let of = |scene: &splitplane_core::scene::Scene| {
            let own = scene.geometry(GeometryId(name)).unwrap().clone();
            (own.mesh().arrays().0.to_vec(), own.mesh().arrays().1.map(<[_]>::to_vec))
        };
        assert_eq!(of(&described), of(&world), "{name}");
    }
    assert_eq!(scene.baked.table, table);
    assert_eq!(
        (&scene.baked.instances[..], &scene.baked.geometries[..]),
        (&[3, 5][..], &[1, 5][..])
    );
    assert_eq!((scene.triangles(), scene.instanced_triangles()), (1 + 5 + 2, 2 + 5 + 2));
    let original = |instance, triangle| {
        let named = scene.baked.table.original(InstanceId(instance), triangle);
        named.map(|(instance, geometry, triangle)| (instance.0, geometry.0, triangle))
    };
    let rocks: Vec<_> = (0..5).filter_map(|triangle| original(1, triangle)).collect();
    assert_eq!(rocks, [(1, 1, 0), (1, 1, 1), (3, 0, 0), (5, 1, 0), (5, 1, 1)]);
    assert_eq!((original(4, 1), original(2, 0)), (Some((4, 1, 1)), None));
    // Materials of instances and triangles; normals as instances show them, and places in pictures.
    let parts = &scene.parts;
    let [rocks, wall] = [3, 4].map(|place: usize| scene.geometries[place].clone());
    assert_eq!((rocks.name.as_str(), wall.name.as_str()), ("rocks", "wall"));
    let range = rocks.triangles.start as usize..rocks.triangles.end as usize;
    let grey = parts.material_of[plain.geometries[1].triangles.start as usize];
    assert_eq!(parts.material_of[range.clone()], [grey, grey, 0, 0, 0]);
    let normals = |triangle: usize| {
        parts.normal_indices[range.start + triangle]
            .map(|named| parts.normals.get(named as usize).copied())
    };
    let near = |found: Option<[f32; 3]>, x: f32, y: f32, z: f32| {
        let found = found.unwrap();
        assert!(found.iter().zip([x, y, z]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
    };
    let turned = normals(0);
    near(turned[0], 1.0, 0.0, 0.0);
    near(turned[1], 0.8, 0.0, -0.6);
    near(normals(3)[1], 0.6, 0.0, 0.8);
    assert_eq!((normals(1), normals(2)), ([None; 3], [None; 3]));
    let places = |geometry: &crate::instanced::Geometry| {
        let named = parts.texcoord_indices[geometry.triangles.start as usize];
        named.map(|named| parts.texcoords[named as usize])
    };
    assert_eq!(places(&rocks), places(&plain.geometries[1]));
    assert_eq!(places(&wall), places(&rocks));
    assert_eq!(parts.normal_indices.len(), parts.indices.len());
    assert_eq!(parts.material_of.len(), parts.indices.len());
    assert!(parts.mesh().is_ok());
    // Pictures and frames.
    let hit = |instance, triangle| FirstHit { instance, triangle, ..FirstHit::MISS };
    let hits = [hit(1, 2), hit(0, 0), FirstHit::MISS, hit(4, 1)];
    let named = scene.baked.original_hits(&hits);
    assert_eq!(named[..], [hit(3, 0), hit(0, 0), FirstHit::MISS, hit(4, 1)]);
    assert_eq!(plain.baked.original_hits(&hits)[..], hits);
    assert_eq!(scene.set(3, &mut described), Ok(1));
    assert_eq!(described.instance(InstanceId(2)).unwrap().transform, translation([0.0, 3.0, 0.0]));
    let eye = scene.placement(1.0, 1).camera.eye();
    assert!(eye.iter().all(|x| x.is_finite()));
}

/// Few instances name more triangles than a mesh may have: that is found before any memory is taken for them.
#[test]
fn what_would_bake_to_too_much_is_refused_at_once() {
    // 100,000 triangles of three corners, 2,700 times: 270 million of 2^28.
    let triangles = "[0,1,2],".repeat(99_999) + "[0,1,2]";
    let instance = "\n{\"geometry\": \"one\", \"bake\": \"all\"},";
    let file = |instances: usize| {
        let instances = instance.repeat(instances);
        format!(
            "{{\"format\": \"splitplane-scene\", \"version\": 1, \"geometries\": [{{\"name\": \"one\", \"positions\": [[0,0,0],[1,0,0],[0,1,0]], \"triangles\": [{triangles}]}}],\n\"instances\": [{}]}}",
            &instances[..instances.len() - 1]
        )
    };
    let folder = folder();
    let error = read_in(&folder, &file(2_700)).unwrap_err();
    assert!(error.problem.is_limit(), "{error}");
    // The first instance with which there are more, on the line after those before: the file has its own 100,000 too.
    let text = error.to_string();
    assert!(text.contains("line 2686, column 29, instances[2683].bake: "), "{text}");
    assert!(text.contains("triangles in all geometries and baked instances together"), "{text}");
    assert_eq!(read_in(&folder, &file(2)).unwrap().triangles(), 200_000);
    // Nor more bytes than are allowed: an instance takes 100,000 times 28, and what two do not suffice for is named with the third.
    let path = folder.path().join("scene.json");
    let within = |text: &str, limit| {
        parse(text, &path, &SceneOptions { memory_limit: Some(limit), ..SceneOptions::default() })
    };
    let least = least_limit(|limit| within(&file(3), limit).is_ok());
    let error = within(&file(3), least - 1).unwrap_err();
    assert!(matches!(*error.problem, SceneFileProblem::Memory { limit, .. } if limit == least - 1));
    assert!(error.to_string().contains("line 5, column 29, instances[2].bake: "), "{error}");
    let error = within(&file(5), least + 4096).unwrap_err();
    assert!(error.problem.is_limit(), "{error}");
    assert!(error.to_string().contains("line 6, column 29, instances[3].bake: "), "{error}");
}

/// The least limit that suffices.
fn least_limit(is_enough: impl Fn(u64) -> bool) -> u64 {
    let (mut less, mut enough) = (0, 1u64 << 32);
    while enough - less > 1 {
        let limit = less.midpoint(enough);
        if is_enough(limit) { enough = limit } else { less = limit }
    }
    enough
}

/// The entry with which there is too much is named where it begins, and how much it would be.
#[test]
fn an_entry_without_memory_is_named_with_its_place() {
    let folder = folder();
    let entries = ",\n  {\"geometry\": \"one\"}".repeat(99);
    let text = format!(
        r#"{{"format": "splitplane-scene", "version": 1,
"geometries": [{{"name": "one", "positions": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,2]]}}],
"instances": [
  {{"geometry": "one"}}{entries}]}}"#
    );
    let path = folder.path().join("scene.json");
    // As `docs/scene-file.md` says.
    #[cfg(target_pointer_width = "64")]
    assert_eq!(
        [
            size_of::<format::Instance<'_>>(),
            size_of::<crate::instanced::Placed>(),
            size_of::<format::Key>(),
            size_of::<format::Geometry<'_>>(),
            size_of::<format::Material<'_>>(),
        ],
        [184, 96, 64, 216, 88]
    );
    let mut places = Vec::new();
    for limit in (0..least_limit(|limit| {
        let options = SceneOptions { memory_limit: Some(limit), ..SceneOptions::default() };
        parse(&text, &path, &options).is_ok()
    }))
        .step_by(64)
    {
        let options = SceneOptions { memory_limit: Some(limit), ..SceneOptions::default() };
        let error = parse(&text, &path, &options).unwrap_err();
        let SceneFileProblem::Memory { needed, .. } = *error.problem else { panic!("{error}") };
        assert!(needed > limit && error.problem.is_limit(), "{error}");
        places.push((error.field.clone(), error.place, needed));
        assert!(
            error.to_string().contains(&format!("{needed} bytes, more than the limit of {limit}"))
        );
    }
    places.dedup();
    // The text; positions and triangles; instances when their list moves: 4, 8, 16 and so on.
    assert_eq!((places[0].0.as_str(), places[0].1, places[0].2), ("", None, text.len() as u64));
    let of = |field: &str| places.iter().find(|own| own.0 == field).map(|own| own.1).unwrap();
    assert_eq!(of("geometries[0]"), Some((2, 16)));
    assert_eq!(of("geometries[0].positions[0]"), Some((2, 46)));
    assert_eq!(of("geometries[0].triangles[0]"), Some((2, 86)));
    for number in [0, 4, 8, 16, 32, 64] {
        assert_eq!(of(&format!("instances[{number}]")), Some((4 + number, 3)));
    }
    assert_eq!(places.iter().filter(|own| own.0.starts_with("instances[")).count(), 6);
}

/// A path is there several times while its file is looked for, which counts before it is.
#[test]
fn a_path_counts_while_its_file_is_looked_for() {
    let folder = folder();
    let long = "x".repeat(4000);
    let file = |geometry: &str, more: &str| {
        format!(
            r#"{{"format": "splitplane-scene", "version": 1{more}, "geometries": [{{"name": "one", {geometry}}}], "instances": [{{"geometry": "one"}}]}}"#
        )
    };
    let triangle = r#""positions": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,2]]"#;
    let mut cases = vec![("geometries[0].obj", file(&format!("\"obj\": \"{long}\""), ""))];
    if cfg!(feature = "environment") {
        let more = format!(", \"environment\": {{\"file\": \"{long}\"}}");
        cases.push(("environment.file", file(triangle, &more)));
    }
    for (field, text) in cases {
        // All but the path fits.
        let limit = text.len() as u64 + 6 * long.len() as u64;
        let options = SceneOptions { memory_limit: Some(limit), ..SceneOptions::default() };
        let error = parse(&text, &folder.path().join("scene.json"), &options).unwrap_err();
        let is_memory = matches!(*error.problem, SceneFileProblem::Memory { .. });
        assert!(error.field == field && is_memory, "{error}");
        let error = read_in(&folder, &text).unwrap_err();
        assert!(error.field == field && !error.problem.is_limit(), "{error}");
    }
}

/// What JSON's reader makes of nesting is an error long before the stack ends, whether it is in a place where something is read or not.
#[test]
fn nesting_ends_in_an_error() {
    let folder = folder();
    let nested = |depth| "[".repeat(depth) + &"]".repeat(depth);
    for from in
        ["[0.7, 0.1, 0.1]", "3,", "\"one\"", "[3, 2, 1]", "[1,0,0,4, 0,1,0,5, 0,0,1,6]", "[0,1,2]"]
    {
        let text = GOOD.replacen(from, &nested(1_000_000), 1);
        assert_ne!(text, GOOD);
        let error = read_in(&folder, &text).unwrap_err();
        assert!(matches!(&*error.problem, SceneFileProblem::Json(_)), "{error}");
    }
    // Where any value may be, the depth is limited.
    let read = |depth| serde_json::from_str::<serde_json::Value>(&nested(depth));
    assert!(read(127).is_ok());
    assert!(read(128).unwrap_err().to_string().contains("recursion limit"));
}

/// Objects are read by our own visitors: what a field may be left out for, what it may be, and what is said where it is wrong.
#[test]
fn fields_are_read_once_and_by_their_names() {
    let folder = folder();
    let cases = [
        (
            "\"frames\": 5",
            "\"frames\": 5, \"frames\": 5",
            "line 2, column ",
            "duplicate field `frames`",
        ),
        ("\"mask\": 3", "\"mask\": 3, \"mask\": 3", "instances[0]: ", "duplicate field `mask`"),
        ("{\"frame\": 1,", "{", "instances[3].keys[0]: ", "missing field `frame`"),
        ("{\"name\": \"lamp\", ", "{", "materials[2]: ", "missing field `name`"),
        ("\"scale\": 2}", "\"scale\": [1, 2, 3, 4]}", "instances[2].scale: ", "a number or three"),
        ("\"scale\": 2}", "\"scale\": [1, 2]}", "instances[2].scale: ", "a number or three"),
        ("\"scale\": 2}", "\"scale\": {}}", "instances[2].scale: ", "a number or three"),
        (
            "{\"geometry\": \"one\", \"tr",
            "[\"one\"], {\"geometry\": \"one\", \"tr",
            "instances[0]: ",
            "missing field",
        ),
        (
            "[1, 2, 3], \"scale\"",
            "null, \"scale\"",
            "instances[1].translate: ",
            "invalid type: null",
        ),
        ("[0,0,0],[1,0,0]", "[0,0,0],[1,1e300,0]", "geometries[0].positions[1]: ", "finite"),
        (
            "\"geometries\": [",
            "\"geometries\": {\"a\": 1}, \"lamps\": [",
            "geometries: ",
            "a sequence",
        ),
    ];
    for (from, to, place, words) in cases {
        let text = GOOD.replacen(from, to, 1);
        assert_ne!(text, GOOD, "{from}");
        let error = read_in(&folder, &text).expect_err(to).to_string();
        assert!(error.contains(place) && error.contains(words), "{to}: {error}");
    }
    // Null is as nothing where that was so, whole numbers are factors, and escapes are read.
    let same = [
        ("\"material\": \"red\"", "\"material\": \"r\\u0065d\""),
        ("\"scale\": 2}", "\"scale\": [2, 2.0, 2e0]}"),
        ("\"culling\": \"back\"", "\"culling\": \"back\", \"bake\": null, \"scale\": null"),
        ("\"lights\"", "\"environment\": null, \"lights\""),
        ("\"scale\": [2, 2, -2]", "\"scale\": [2e0, 2.0, -2]"),
    ];
    let wanted = read_in(&folder, GOOD).unwrap();
    for (from, to) in same {
        let text = GOOD.replacen(from, to, 1);
        assert_ne!(text, GOOD, "{from}");
        assert_eq!(read_in(&folder, &text).unwrap(), wanted, "{to}");
    }
}

/// One .obj file by two hundred paths is read once: otherwise a small file would ask for two hundred times what it has.
#[test]
fn a_file_by_many_paths_is_read_once() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    std::fs::write(folder.path().join("other.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        .unwrap();
    let geometries: String = (0..200)
        .map(|number| {
            let path =
                format!("{}{}other.obj", "./".repeat(number / 2), ["", "sub/../"][number % 2]);
            format!("{{\"name\": \"g{number}\", \"obj\": \"{path}\"}},")
        })
        .collect();
    let text = format!(
        "{{\"format\": \"splitplane-scene\", \"version\": 1, \"geometries\": [{}], \"instances\": [{{\"geometry\": \"g199\"}}]}}",
        geometries.trim_end_matches(',')
    );
    let scene = read_in(&folder, &text).unwrap();
    assert_eq!((scene.triangles(), scene.geometries.len()), (1, 1));
    // A file that is not there is named as it is written.
    let error = read_in(&folder, &text.replacen("other.obj", "nowhere.obj", 1)).unwrap_err();
    assert!(error.to_string().contains("geometries[0].obj: "), "{error}");
}

/// What cannot be baked is refused, with its place.
#[test]
fn what_cannot_be_baked_is_named_with_its_place() {
    let folder = folder();
    std::fs::write(folder.path().join("smooth.obj"), SMOOTH).unwrap();
    let cases = [
        (
            "\"one\", \"keys\"",
            "\"one\", \"bake\": \"rocks\", \"keys\"",
            "line 12, column 33, instances[2].bake: ",
            "keys move",
        ),
        (
            "{\"geometry\": \"balls\"}",
            "{\"geometry\": \"balls\", \"bake\": \"rocks\"}",
            "line 16, column 35, instances[6].bake: ",
            "shapes",
        ),
        (
            "\"scale\": 2, \"id\": 7",
            "\"scale\": 2, \"id\": 8",
            "instances[5].bake: instance 5 has another number than instance 1",
            "line 15",
        ),
        (
            "\"scale\": 2, \"id\": 7",
            "\"scale\": 2, \"id\": 7, \"mask\": 1",
            "instances[5].bake: ",
            "another mask",
        ),
        (
            "\"scale\": 2, \"id\": 7",
            "\"scale\": 2, \"id\": 7, \"culling\": \"back\"",
            "instances[5].bake: ",
            "another culling",
        ),
        (
            "\"scale\": [-1, 2, 1]",
            "\"scale\": [-1, 2, 1], \"material\": \"glass\"",
            "line 13, column 33, instances[3].bake: ",
            "glass",
        ),
        (
            "\"translate\": [0, 0, 16]",
            "\"translate\": [0, 0, 16], \"scale\": 3e38",
            "instances[4]",
            "",
        ),
        ("\"bake\": \"wall\"", "\"bake\": 3", "instances[4].bake: ", "string"),
    ];
    for (from, to, place, words) in cases {
        let text = BAKED.replacen(from, to, 1);
        assert_ne!(text, BAKED, "{from}");
        let error = read_in(&folder, &text).expect_err(to).to_string();
        assert!(error.contains(place) && error.contains(words), "{to}: {error}");
    }
    // A body of glass that is not reflected can be, and one that is reflected and not clear.
    let text = BAKED.replacen("\"scale\": 2,", "\"scale\": 2, \"material\": \"glass\",", 1);
    let text = text.replacen("\"material\": \"red\", \"scale\"", "\"scale\"", 1);
    assert!(read_in(&folder, &text).is_ok());
}

#[test]
fn links_and_copies_of_an_obj_file_are_within_the_limit() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    // One triangle and vertices that it does not have: no part of it is large.
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n".repeat(1000) + "f 1 2 3\n";
    std::fs::write(place("0.obj"), &text).unwrap();
    std::fs::hard_link(place("0.obj"), place("1.obj")).unwrap();
    std::fs::copy(place("0.obj"), place("2.obj")).unwrap();
    let own = |n: u32| format!(r#"{{"name":"{n}","obj":"{n}.obj"}}"#);
    let lines = [own(0), own(1), own(2)].join(",\n");
    let file = format!(
        "{{\"format\":\"splitplane-scene\",\"version\":1,\"instances\":[{{\"geometry\":\"0\"}}],\"geometries\":[\n{lines}]}}"
    );
    let read = |limit| {
        let options = SceneOptions { memory_limit: Some(limit), ..SceneOptions::default() };
        parse(&file, &place("scene.json"), &options)
    };
    // Of each further file its text, while it is read, 3,000 vertices of 12 bytes, and one triangle of 16. The first file is what it is.
    let (one, least) = (3000 * 12 + 16, least_limit(|limit| read(limit).is_ok()));
    assert!(least > 2 * one + text.len() as u64, "{least}");
    for (limit, line) in [(least - 1, 4), (one, 3)] {
        let error = read(limit).unwrap_err();
        assert_eq!(
            (error.place, error.field.as_str()),
            (Some((line, 19)), ["geometries[1].obj", "geometries[2].obj"][line - 3]),
            "{error}"
        );
        let SceneFileProblem::Memory { needed, limit: named } = *error.problem else {
            panic!("{error}")
        };
        assert!(needed > limit && named == limit, "{error}");
    }
    // One that its size alone makes too large is not read.
    let large = std::fs::File::create(place("2.obj")).unwrap();
    large.set_len(4 << 30).unwrap();
    let options = SceneOptions {
        memory_limit: Some(1 << 20),
        file_limit: Some(u64::MAX),
        ..SceneOptions::default()
    };
    let error = parse(&file, &place("scene.json"), &options).unwrap_err();
    assert_eq!(error.field, "geometries[2].obj");
    assert!(
        matches!(*error.problem, SceneFileProblem::Memory { needed, .. } if needed > 4 << 30),
        "{error}"
    );
}
