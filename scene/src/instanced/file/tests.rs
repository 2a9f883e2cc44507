//! Good files, and files that are broken in every place.

use super::*;
use crate::instanced::InstancedScene;
use splitplane_core::scene::translation;

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
