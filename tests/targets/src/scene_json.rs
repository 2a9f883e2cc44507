//! Scene files in JSON: a good one with tokens changed, doubled, left out or put elsewhere; any bytes.

use crate::folder;
use crate::source::Source;
use splitplane::core::backend::{Backend, BuildOptions};
use splitplane::scene::SceneOptions;
use splitplane::scene::instanced::parse;
use splitplane_cpu::CpuBackend;

const TWO: &str =
    "o plate\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng left\nf 1 2 3\ng right\nf 1 3 4\n";

const GOOD: &str = r#"{ "format": "splitplane-scene" , "version": 1 , "frames": 4 , "seconds_per_frame": 0.5 ,
"materials": [ { "name": "red" , "diffuse": [ 0.7 , 0.1 , 0.1 ] , "mirror": [ 0.1 , 0.1 , 0.1 ] } ,
{ "name": "glass" , "glass": { "index": 1.5 , "tint": [ 1 , 0.9 , 0.9 ] } } , { "name": "lamp" , "emission": [ 3 , 2 , 1 ] } ] ,
"geometries": [ { "name": "one" , "positions": [ [ 0 , 0 , 0 ] , [ 1 , 0 , 0 ] , [ 0 , 1 , 0 ] ] , "triangles": [ [ 0 , 1 , 2 ] ] , "material": "red" } ,
{ "name": "left" , "obj": "two.obj" , "group": "left" } , { "name": "all" , "obj": "two.obj" } , { "name": "plate" , "obj": "two.obj" , "object": "plate" } ] ,
"instances": [ { "geometry": "one" , "transform": [ 1 , 0 , 0 , 4 , 0 , 1 , 0 , 5 , 0 , 0 , 1 , 6 ] , "mask": 3 , "id": 7 , "culling": "back" } ,
{ "geometry": "left" , "translate": [ 1 , 2 , 3 ] , "scale": [ 2 , 2 , -2 ] , "material": "glass" } ,
{ "geometry": "plate" , "rotate": { "axis": [ 0 , 1 , 0 ] , "degrees": 90 } , "scale": 2 , "bake": "plates" } , { "geometry": "all" , "bake": "plates" } ,
{ "geometry": "all" , "keys": [ { "frame": 1 , "translate": [ 0 , 1 , 0 ] } , { "frame": 3 , "translate": [ 0 , 3 , 0 ] } ] } ] ,
"cameras": [ { "eye": [ 0 , 0 , 9 ] , "at": [ 0 , 0 , 0 ] , "fov_degrees": 30 } ] ,
"lights": [ { "point": { "position": [ 1 , 2 , 3 ] , "irradiance": [ 1 , 1 , 1 ] , "distance": 4 } } , { "sun": { "towards": [ 0 , 1 , 0 ] , "irradiance": [ 1 , 1 , 1 ] } } ] }"#;

/// What may stand in the place of a token.
const ODD: [&str; 24] = [
    "0",
    "-1",
    "1e39",
    "-1e300",
    "1e-46",
    "1e400",
    "4294967295",
    "4294967296",
    "0.5",
    "null",
    "true",
    "\"\"",
    "\"left\"",
    "\"../two.obj\"",
    "\"\\u0000\"",
    "[ ]",
    "{ }",
    "[",
    "]",
    "{",
    "}",
    ",",
    "\"keys\":",
    "\u{e9}",
];

thread_local! {
    static BACKEND: CpuBackend = CpuBackend::new();
}

/// Bytes as a scene file. What is read has to be described, moved and built, or refused by an error that says where.
pub fn run(data: &[u8]) {
    crate::single_thread();
    let mut source = Source::new(data);
    let folder = folder::path("two.obj");
    if !folder.is_file() {
        folder::write("two.obj", TWO.as_bytes());
    }
    let path = folder.with_file_name("some.json");
    let text = if source.once_in(8) {
        String::from_utf8_lossy(source.rest()).into_owned()
    } else {
        changed(&mut source)
    };
    let mut scene = match parse(&text, &path, &SceneOptions::default()) {
        Ok(scene) => scene,
        Err(error) => return crate::check_message(&error.to_string(), "some.json"),
    };
    let described = scene.describe();
    let mut described = match described {
        Ok(described) => described,
        Err(error) => return crate::check_message(&error.to_string(), ""),
    };
    let instances = scene.instances.len() - scene.baked.instances.len();
    assert_eq!(described.len(), instances);
    for frame in [0, 1, scene.frames - 1] {
        if let Err(error) = scene.set(frame, &mut described) {
            return crate::check_message(&error.to_string(), "");
        }
    }
    assert!(scene.parts.mesh().is_ok());
    let built = BACKEND.with(|backend| backend.build_scene(&described, &BuildOptions::default()));
    assert_eq!(built.expect("a scene").scene().placements().count(), instances);
}

/// The good file with some tokens changed.
fn changed(source: &mut Source<'_>) -> String {
    let mut tokens: Vec<&str> = GOOD.split_whitespace().collect();
    for _ in 0..source.below(5) {
        let at = source.below(tokens.len());
        match source.below(5) {
            0 => drop(tokens.remove(at)),
            1 => tokens.insert(at, tokens[at]),
            2 => {
                let other = source.below(tokens.len());
                tokens.swap(at, other);
            }
            _ => tokens[at] = source.pick(&ODD),
        }
    }
    tokens.join(" ")
}
