//! Pictures of small scenes against reference pictures in `tests/images`.
//!
//! Tolerance: at most 1 pixel in 200 may differ by more than 2 of 255 in a channel, and none by more than
//! 64. On the machine that made them they are equal; elsewhere nothing should differ either, since
//! every operation is rounded once, but trees may come to tell hits on edges apart in another order.
//!
//! `SPLITPLANE_UPDATE_IMAGES=1 cargo test --features picture --test suite images::` writes them; look
//! at them before you commit.

use image::RgbImage;
use splitplane::picture;
use splitplane::render::{RenderSettings, Size};
use splitplane::scene::{Placement, Scene};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane::{BuildOptions, CpuBackend};
use std::path::PathBuf;

const SIZE: [u32; 2] = [96, 64];

/// Why two pictures are not the same within the tolerance.
fn difference(got: &RgbImage, expected: &RgbImage) -> Option<String> {
    if got.dimensions() != expected.dimensions() {
        return Some(format!("{:?} in place of {:?}", got.dimensions(), expected.dimensions()));
    }
    let apart = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| {
        a.0.into_iter().zip(b.0).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
    };
    let apart: Vec<u8> = got.pixels().zip(expected.pixels()).map(apart).collect();
    let differ = apart.iter().filter(|apart| **apart > 2).count();
    let most = apart.iter().max().copied().unwrap_or(0);
    let allowed = apart.len() / 200;
    (differ > allowed || most > 64)
        .then(|| format!("{differ} pixels differ, {allowed} may; the most by {most}"))
}

fn reference(name: &str) -> PathBuf {
    let file = format!("{}.png", name.replace(':', "-"));
    [env!("CARGO_MANIFEST_DIR"), "tests", "images", &file].iter().collect()
}

fn render(name: &str, settings: RenderSettings) -> RgbImage {
    let mut scene = Scene::open(format!("builtin:{name}")).unwrap();
    let (mesh, appearance) = (scene.mesh().unwrap(), scene.appearance());
    let options = BuildOptions::default();
    let mut tracer = Tracer::load(CpuBackend::new(), &mesh, &appearance, &options).unwrap();
    let size = Size::new(SIZE[0], SIZE[1]).unwrap();
    let placement = Placement::of(&scene, tracer.accelerator().unwrap(), size.aspect()).unwrap();
    scene.lights = placement.lights;
    let mesh = scene.mesh().unwrap();
    tracer.update_appearance(&mesh, &scene.appearance()).unwrap();
    let request =
        FrameRequest { settings, ..FrameRequest::new(placement.camera.pinhole(size), size) };
    let frame = tracer.frame(&mesh, &request).unwrap();
    picture::screen(size, &frame.pixels().unwrap()).unwrap()
}

fn check(name: &str, settings: RenderSettings) {
    let (got, path) = (render(name, settings), reference(name));
    if std::env::var_os("SPLITPLANE_UPDATE_IMAGES").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, picture::encode_png(&got).unwrap()).unwrap();
    }
    let expected = image::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    if let Some(why) = difference(&got, &expected.to_rgb8()) {
        panic!("{name} is not its reference picture: {why}");
    }
}

#[test]
fn cornell() {
    check("cornell", RenderSettings::default());
}

#[test]
fn spheres() {
    check("spheres", RenderSettings { samples: 2, ..RenderSettings::default() });
}

#[test]
fn gallery() {
    check("gallery", RenderSettings { samples: 2, ..RenderSettings::default() });
}

#[test]
fn carousel() {
    check("carousel:6000", RenderSettings { depth: 3, ..RenderSettings::default() });
}

#[test]
fn city() {
    check("city:10000", RenderSettings { depth: 0, ..RenderSettings::default() });
}

/// The tolerance is no blank cheque: one bounce less, half the ambient light, or a picture moved by a
/// pixel is another picture.
#[test]
fn other_pictures_are_told_apart() {
    let expected = render("spheres", RenderSettings::default());
    let shallow = RenderSettings { depth: 1, ..RenderSettings::default() };
    assert!(difference(&render("spheres", shallow), &expected).is_some());
    let dim = RenderSettings { ambient: 0.2, ..RenderSettings::default() };
    assert!(difference(&render("spheres", dim), &expected).is_some());
    let mut moved = expected.clone();
    for (x, y, pixel) in expected.enumerate_pixels() {
        moved.put_pixel((x + 1) % SIZE[0], y, *pixel);
    }
    assert!(difference(&moved, &expected).is_some());
    assert_eq!(difference(&expected, &expected), None);
}
