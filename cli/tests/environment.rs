//! Environment maps from outside: files that light scenes, options, scene files, and what is refused.

use crate::common::{ends, fail};
use std::fs;
use tempfile::TempDir;

/// What is printed, and what is said beside it.
#[track_caller]
fn succeed(folder: &TempDir, arguments: &[&str]) -> String {
    let (out, error) = ends(folder, 0, arguments);
    out + &error
}

/// A Radiance picture without compression: grey by the part of a texel's exponent.
fn hdr(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
    let head = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n";
    let mut bytes = format!("{head}-Y {height} +X {width}\n").into_bytes();
    bytes.extend((0..width * height).flat_map(|at| texel(at % width, at / width)));
    bytes
}

/// A folder with an even grey map, one of a bright half, and a floor that is seen from above.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    // A half everywhere: 128 * 2^(128 - 136).
    write("even.hdr", &hdr(4, 2, |_, _| [128, 128, 128, 128]));
    write("left.hdr", &hdr(4, 2, |column, _| [128, 128, 128, if column < 2 { 130 } else { 120 }]));
    write("floor.obj", b"v -9 0 9\nv 9 0 9\nv 9 0 -9\nv -9 0 -9\nf 1 2 3 4\n");
    let scene = |more: &str| {
        format!(
            "{{\"format\": \"splitplane-scene\", \"version\": 1,\n \"materials\": [{{\"name\": \"white\", \"diffuse\": [1, 1, 1]}}],\n \
             \"geometries\": [{{\"name\": \"f\", \"obj\": \"floor.obj\", \"material\": \"white\"}}],\n \
             \"instances\": [{{\"geometry\": \"f\", \"material\": \"white\"}}],\n \
             \"cameras\": [{{\"eye\": [0, 1, 0], \"at\": [0, 0, 0], \"up\": [0, 0, -1]}}],\n \"environment\": {more}}}"
        )
    };
    write("scene.json", scene("{\"file\": \"even.hdr\", \"strength\": 1.5}").as_bytes());
    write("missing.json", scene("{\"file\": \"no.hdr\"}").as_bytes());
    write("odd.json", scene("{\"file\": \"even.hdr\", \"strength\": -1}").as_bytes());
    write("bright.json", scene("{\"file\": \"left.hdr\", \"strength\": 1e12}").as_bytes());
    write("bad.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9 +X 9\n");
    folder
}

const SMALL: [&str; 4] = ["--size", "12x8", "--quiet", "--no-lights"];

/// The mean of a linear picture.
fn mean(folder: &TempDir, name: &str) -> f32 {
    let picture = image::open(folder.path().join(name)).unwrap().to_rgb32f();
    picture.pixels().map(|pixel| pixel.0[1]).sum::<f32>() / picture.pixels().len() as f32
}

#[test]
fn maps_light_what_is_shown() {
    let folder = folder();
    let down = ["--camera-eye", "0,1,0", "--camera-at", "0,0,0", "--camera-up", "0,0,-1"];
    for more in [&["--samples", "32"][..], &["--samples", "32", "--transport", "paths"]] {
        let of = |scene: &str, options: &[&str]| {
            let camera = if scene == "floor.obj" { &down[..] } else { &[] };
            let arguments = [&["render", scene, "-o", "a.exr"], options, more, &SMALL, camera];
            succeed(&folder, &arguments.concat());
            mean(&folder, "a.exr")
        };
        let near = |found: f32, want: f32| {
            assert!((found / want - 1.0).abs() < 0.02, "{found} {want} {more:?}");
        };
        let even = of("floor.obj", &["--environment", "even.hdr"]);
        let strong = ["--environment", "even.hdr", "--environment-strength", "4"];
        near(of("floor.obj", &strong), 4.0 * even);
        // White under a half, one and a half times as strong; and what the user says goes before.
        near(of("scene.json", &[]), 0.75);
        near(of("scene.json", &["--environment", "even.hdr"]), 0.5);
        let turned = ["--environment", "left.hdr", "--environment-rotation", "180"];
        near(of("scene.json", &turned), of("scene.json", &turned[..2]));
    }
    // From the middle of the picture to the left it is bright; turned around it is dark there.
    let aside = ["--camera-eye", "0,1,0", "--camera-at", "-1,1.5,0", "--fov", "20"];
    let seen = |options: &[&str]| {
        let arguments = [&["render", "floor.obj", "-o", "a.exr"], options, &SMALL, &aside];
        succeed(&folder, &arguments.concat());
        mean(&folder, "a.exr")
    };
    let turned = ["--environment", "left.hdr", "--environment-rotation", "-180"];
    assert!((seen(&turned[..2]) - 2.0).abs() < 1e-5 && seen(&turned) < 0.01);
}

/// No lamps are placed where a map shines.
#[test]
fn choices_are_said() {
    let folder = folder();
    let arguments = ["render", "floor.obj", "-o", "a.png", "--size", "8x8", "--samples", "1"];
    let said = succeed(&folder, &[&arguments[..], &["--environment", "even.hdr"]].concat());
    assert!(said.contains("lights   none but the environment"), "{said}");
    let said = succeed(&folder, &arguments);
    assert!(said.contains("lights   1, placed"), "{said}");
    // Parts of a picture agree in the map.
    let part = |environment: &str, part: &str, to: &str| {
        let options = ["--environment", environment, "--part", part, "-o", to, "--quiet"];
        let arguments = ["render", "floor.obj", "--size", "8x8", "--samples", "1"];
        succeed(&folder, &[&arguments[..], &options].concat());
    };
    part("even.hdr", "1/2", "1.picpart");
    part("even.hdr", "2/2", "2.picpart");
    part("left.hdr", "2/2", "other.picpart");
    let whole = ["--environment", "even.hdr", "--quiet"];
    succeed(&folder, &[&arguments[..], &whole].concat());
    succeed(&folder, &["merge", "1.picpart", "2.picpart", "-o", "b.png"]);
    let [a, b] = ["a.png", "b.png"].map(|name| fs::read(folder.path().join(name)).unwrap());
    assert!(a == b);
    let error = fail(&folder, 3, &["merge", "1.picpart", "other.picpart", "-o", "b.png"]);
    assert!(
        error.contains("of another picture") && error.contains("`materials and lights` is"),
        "{error}"
    );
}

#[test]
fn what_cannot_be_is_refused() {
    let folder = folder();
    let render = |code, options: &[&str]| {
        let arguments = [&["render", "floor.obj", "-o", "a.png"], options, &SMALL].concat();
        fail(&folder, code, &arguments)
    };
    let usage = |more: &[&str]| render(2, &[&["--environment", "even.hdr"], more].concat());
    assert!(usage(&["--ambient", "0.5"]).contains("all light is sampled"));
    assert!(usage(&["--environment-strength=-1"]).contains("from 0 to 1e12"));
    assert!(usage(&["--environment-strength", "nan"]).contains("from 0 to 1e12"));
    assert!(usage(&["--environment-rotation", "inf"]).contains("must be finite"));
    assert!(render(2, &["--environment", "sunset"]).contains("a .hdr or .exr"));
    let error = render(2, &["--environment", "sky", "--environment-rotation", "9"]);
    assert!(error.contains("--environment-rotation is of pictures"), "{error}");
    assert!(render(2, &["--environment-strength", "9"]).contains("--environment <"));
    let error = render(3, &["--environment", "no.hdr"]);
    assert!(error.contains("the environment in `no.hdr`: there is no such file"), "{error}");
    assert!(render(3, &["--environment", "bad.hdr"]).contains("`bad.hdr`: "));
    let error = render(4, &["--environment", "even.hdr", "--max-texture", "100"]);
    assert!(error.contains("4x2 texels takes 224 bytes") && error.contains("--max-texture"));
    let error = render(4, &["--environment", "even.hdr", "--max-file", "60"]);
    // The scene itself is as long as the limit allows.
    assert!(error.contains("more than 60 bytes") && error.contains("--max-file"), "{error}");
    let scene = |code, name: &str| {
        fail(&folder, code, &[&["render", name, "-o", "a.png"][..], &SMALL].concat())
    };
    let error = scene(3, "missing.json");
    assert!(error.contains("line 6, column") && error.contains("environment.file"), "{error}");
    assert!(scene(3, "odd.json").contains("environment.strength"));
    assert!(scene(3, "bright.json").contains("environment.strength"), "too bright");
    let ambient = ["render", "scene.json", "-o", "a.png", "--ambient", "0.5"];
    assert!(fail(&folder, 2, &ambient).contains("--ambient is of environments of colours"));
}
