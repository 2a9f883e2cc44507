//! Answers that the package for JavaScript has to give too, bit for bit: `web/tests` asks the same of the same meshes, which both make from
//! whole numbers by single operations, and compares with the snapshots of this test.

use splitplane::core::tree::file;
use splitplane::objects::{Instance, Scene, SceneHit, SceneOptions};
use splitplane::{
    Accelerator, Accuracy, AllHitsOptions, Backend, BuildOptions, ClosestPoint,
    ClosestPointOptions, CpuBackend, Culling, Hit, LocateOptions, Mesh, Preset, QueryLayout,
    QueryOptions, Ray,
};

/// Numbers from -1 to 1, of a linear congruential generator.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    fn point(&mut self, scale: f32) -> [f32; 3] {
        [(); 3].map(|()| self.next() * scale)
    }
}

/// FNV-1a of words.
struct Hash(u32);

impl Hash {
    fn new() -> Hash {
        Hash(0x811c_9dc5)
    }

    fn add(&mut self, words: impl IntoIterator<Item = u32>) {
        for word in words {
            self.0 = (self.0 ^ word).wrapping_mul(0x0100_0193);
        }
    }

    fn of(words: impl IntoIterator<Item = u32>) -> String {
        let mut hash = Hash::new();
        hash.add(words);
        format!("{:08x}", hash.0)
    }
}

type Arrays = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// A closed sphere: the faces of a cube, cut into squares, at distance 1.
fn sphere(cuts: u32) -> Arrays {
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for face in 0..6 {
        let first = positions.len() as u32;
        for i in 0..=cuts {
            for j in 0..=cuts {
                let (a, b) =
                    (2.0 * i as f32 / cuts as f32 - 1.0, 2.0 * j as f32 / cuts as f32 - 1.0);
                let side = if face % 2 == 0 { 1.0 } else { -1.0 };
                let (x, y, z) = match face / 2 {
                    0 => (side, a, b * side),
                    1 => (b * side, side, a),
                    _ => (a, b * side, side),
                };
                let length = (x * x + y * y + z * z).sqrt();
                positions.push([x / length, y / length, z / length]);
            }
        }
        for i in 0..cuts {
            for j in 0..cuts {
                let corner = first + i * (cuts + 1) + j;
                let (right, below) = (corner + 1, corner + cuts + 1);
                indices.push([corner, below, right]);
                indices.push([right, below, below + 1]);
            }
        }
    }
    (positions, indices)
}

/// Triangles anywhere, of any shape, and some that a build drops.
fn noise(count: u32) -> Arrays {
    let mut numbers = Numbers(7);
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for triangle in 0..count {
        let [x, y, z] = numbers.point(4.0);
        for _ in 0..3 {
            let [dx, dy, dz] = numbers.point(0.5);
            positions.push([x + dx, y + dy, z + dz]);
        }
        let first = 3 * triangle;
        let third = if triangle % 50 == 49 { first } else { first + 2 };
        indices.push([first, first + 1, third]);
    }
    (positions, indices)
}

fn rays(count: usize, scale: f32) -> Vec<Ray> {
    let mut numbers = Numbers(11);
    let ray = |_| {
        let (from, to) = (numbers.point(3.0 * scale), numbers.point(scale));
        let direction = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
        Ray { origin: from, t_min: 0.0, direction, t_max: 4.0 }
    };
    (0..count).map(ray).collect()
}

fn hit_words(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
}

/// All queries of a tree, a line each.
fn answers(tree: &dyn Accelerator, scale: f32, lines: &mut Vec<String>) {
    let rays = rays(3000, scale);
    for accuracy in Accuracy::ALL {
        for (side, culling) in
            [("none", Culling::None), ("back", Culling::Back), ("front", Culling::Front)]
        {
            let options = QueryOptions { accuracy, culling, ..QueryOptions::default() };
            let mut hits = vec![Hit::MISS; rays.len()];
            tree.closest_hits(&rays, &mut hits, &options).unwrap();
            let found = hits.iter().filter(|hit| hit.is_hit()).count();
            let hash = Hash::of(hits.iter().flat_map(hit_words));
            lines.push(format!("closest {} {side}: {found} {hash}", accuracy.name()));
            let mut occluded = vec![false; rays.len()];
            tree.any_hits(&rays, &mut occluded, &options).unwrap();
            let hash = Hash::of(occluded.iter().map(|&hit| u32::from(hit)));
            lines.push(format!("any {} {side}: {hash}", accuracy.name()));
        }
    }
    let all = tree.all_hits(&rays, &AllHitsOptions::default()).unwrap();
    let mut hash = Hash::new();
    hash.add(all.starts.iter().map(|&start| start as u32));
    for crossing in &all.crossings {
        hash.add(hit_words(&crossing.hit));
        hash.add([u32::from(crossing.front)]);
    }
    lines.push(format!("all: {} {:08x}", all.crossings.len(), hash.0));
    let mut numbers = Numbers(13);
    let points: Vec<[f32; 3]> = (0..500).map(|_| numbers.point(1.25 * scale)).collect();
    let located = tree.locate(&points, &LocateOptions::default()).unwrap();
    let words = located.windings.iter();
    let words = words.flat_map(|w| [w.unwrap_or(0) as u32, u32::from(w.is_none())]);
    lines.push(format!("windings: {}", Hash::of(words)));
    let mut closest = vec![ClosestPoint::NONE; points.len()];
    let options = ClosestPointOptions { max_distance: 0.5 * scale, ..Default::default() };
    tree.closest_points(&points, &mut closest, &options).unwrap();
    let words = closest.iter().flat_map(|found| {
        let square = found.distance_squared.to_bits();
        let [x, y, z] = found.point.map(f32::to_bits);
        let (u, v) = (found.u.to_bits(), found.v.to_bits());
        [square as u32, (square >> 32) as u32, x, y, z, found.triangle, u, v]
    });
    lines.push(format!("closest points: {}", Hash::of(words)));
}

fn of_mesh((positions, indices): &Arrays, scale: f32) -> String {
    let mesh = Mesh::indexed(positions, indices).unwrap();
    let mut lines = Vec::new();
    for preset in [Preset::Fast, Preset::Narrow, Preset::Balanced, Preset::Best] {
        let tree = CpuBackend::new().build(&mesh, &BuildOptions::from(preset)).unwrap();
        lines.push(format!("digest {}: {}", preset.name(), tree.tree().digest()));
    }
    let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let bytes = file::write(&tree.tree().view(), &mesh).unwrap();
    let hash = Hash::of(bytes.iter().map(|&byte| u32::from(byte)));
    lines.push(format!("file: {} {hash}", bytes.len()));
    answers(&*tree, scale, &mut lines);
    let compact = BuildOptions { layout: QueryLayout::Compact, ..BuildOptions::default() };
    let tree = CpuBackend::new().build(&mesh, &compact).unwrap();
    let mut others = Vec::new();
    answers(&*tree, scale, &mut others);
    assert_eq!(lines[5..], others, "the layout changes no answer");
    lines.join("\n")
}

#[test]
fn a_sphere_is_the_same_in_a_browser() {
    insta::assert_snapshot!("web_sphere", of_mesh(&sphere(24), 1.0));
}

#[test]
fn noise_is_the_same_in_a_browser() {
    insta::assert_snapshot!("web_noise", of_mesh(&noise(4000), 4.0));
}

#[test]
fn instances_are_the_same_in_a_browser() {
    let mut scene = Scene::new();
    let [ball, soup] = [sphere(6), noise(300)].map(|(positions, indices)| {
        scene.add_mesh(&Mesh::indexed(&positions, &indices).unwrap()).unwrap()
    });
    let mut numbers = Numbers(17);
    for number in 0..40 {
        let geometry = if number % 4 == 3 { soup } else { ball };
        let transform = [0, 1, 2].map(|row| {
            let [x, y, z] = numbers.point(0.25);
            let mut parts = [x, y, z, numbers.next() * 4.0];
            parts[row] += if number % 5 == 4 { -0.75 } else { 0.75 };
            parts
        });
        let mask = 1 << (number % 3);
        scene.add_instance(Instance { mask, ..Instance::new(geometry, transform) }).unwrap();
    }
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    let mut lines = vec![format!("digest: {}", built.scene().digest())];
    let rays = rays(2000, 4.0);
    for mask in [u32::MAX, 5] {
        let options = SceneOptions { mask, ..SceneOptions::default() };
        let mut hits = vec![SceneHit::MISS; rays.len()];
        built.closest_hits(&rays, &mut hits, &options).unwrap();
        let found = hits.iter().filter(|hit| hit.is_hit()).count();
        let words = hits.iter().flat_map(|hit| {
            let [t, u, v] = [hit.t, hit.u, hit.v].map(f32::to_bits);
            [t, u, v, hit.triangle, hit.geometry, hit.instance]
        });
        lines.push(format!("closest {mask}: {found} {}", Hash::of(words)));
        let mut occluded = vec![false; rays.len()];
        built.any_hits(&rays, &mut occluded, &options).unwrap();
        let hash = Hash::of(occluded.iter().map(|&hit| u32::from(hit)));
        lines.push(format!("any {mask}: {hash}"));
    }
    insta::assert_snapshot!("web_instances", lines.join("\n"));
}

/// As the demonstration page makes them, without a step of its camera.
#[cfg(feature = "render")]
#[test]
fn pictures_are_the_same_in_a_browser() {
    use splitplane::render::{RenderSettings, Size};
    use splitplane::scene::{Placement, builtin};
    use splitplane::tracer::{FrameRequest, Tracer};

    let mut lines = Vec::new();
    for name in ["cornell", "spheres", "gallery", "city:3000"] {
        let mut scene = builtin::open(name).unwrap();
        let is_lit = scene.is_lit();
        let mesh = scene.mesh().unwrap();
        let options = BuildOptions::default();
        let mut tracer =
            Tracer::load(CpuBackend::new(), &mesh, &scene.appearance(), &options).unwrap();
        let placed = Placement::of(&scene, tracer.accelerator().unwrap(), 1.5).unwrap();
        scene.lights.clone_from(&placed.lights);
        let mut settings = RenderSettings::default();
        if !is_lit {
            settings.headlight = RenderSettings::PLACED_HEADLIGHT;
        }
        if placed.inside {
            settings.ambient = RenderSettings::INSIDE_AMBIENT;
        }
        let mesh = scene.mesh().unwrap();
        tracer.update_appearance(&mesh, &scene.appearance()).unwrap();
        let size = Size::new(96, 64).unwrap();
        let mut request = FrameRequest::new(placed.camera.pinhole(size), size);
        request.settings = settings;
        let digest = tracer.digest().unwrap();
        for accuracy in Accuracy::ALL {
            request.query.accuracy = accuracy;
            let frame = tracer.frame(&mesh, &request).unwrap();
            let hash = Hash::of(frame.pixels().unwrap().iter().copied());
            lines.push(format!("{name} {digest} {}: {hash}", accuracy.name()));
        }
    }
    insta::assert_snapshot!("web_pictures", lines.join("\n"));
}
