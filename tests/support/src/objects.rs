//! Scenes of many objects that transforms, boxes and waves trip over, and rays for them.

use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Culling, Ray};
use splitplane_core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane_core::scene::{
    GeometryId, IDENTITY, Instance, InstanceId, OpacityMask, Scene, Transform,
};

use crate::random::Random;
use crate::scenes;

/// What is hard about a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Nothing: turned, scaled and moved by ordinary amounts.
    Ordinary,
    /// Scales from 1e-6 to 1e6.
    Scales,
    /// Thin, sheared, mirrored, next to singular.
    IllConditioned,
    /// Far from the origin, for their size.
    Far,
    /// Many in one place, and many with one transform.
    Coincident,
    /// Next to the greatest and the least floats.
    Wide,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 6] = [
        Kind::Ordinary,
        Kind::Scales,
        Kind::IllConditioned,
        Kind::Far,
        Kind::Coincident,
        Kind::Wide,
    ];
}

/// Meshes for scenes of objects: closed and open ones, large triangles and small, one without any.
pub fn meshes(seed: u64) -> Vec<scenes::Scene> {
    vec![
        scenes::sphere(8, [0.0; 3], 1.0),
        scenes::grid_boxes(2),
        scenes::soup(200, 0.3, seed),
        scenes::one(),
        scenes::none(),
        scenes::needles(40),
        scenes::sphere(6, [1000.0, -500.0, 0.25], 0.5),
    ]
}

/// Product of two transforms: first the second.
pub fn product(a: &Transform, b: &Transform) -> Transform {
    [0, 1, 2].map(|row| {
        [0, 1, 2, 3].map(|column| {
            let own = if column == 3 { f64::from(a[row][3]) } else { 0.0 };
            let sum: f64 = (0..3).map(|k| f64::from(a[row][k]) * f64::from(b[k][column])).sum();
            (sum + own) as f32
        })
    })
}

/// A rotation about a random axis by a random angle.
pub fn rotation(random: &mut Random) -> Transform {
    let [x, y, z] = random.direction();
    let (sin, cos) = random.between(0.0, core::f64::consts::TAU).sin_cos();
    let other = 1.0 - cos;
    let row = |a: f64, b: f64, c: f64| [a as f32, b as f32, c as f32, 0.0];
    [
        row(cos + x * x * other, x * y * other - z * sin, x * z * other + y * sin),
        row(y * x * other + z * sin, cos + y * y * other, y * z * other - x * sin),
        row(z * x * other - y * sin, z * y * other + x * sin, cos + z * z * other),
    ]
}

/// Scales along the axes.
pub fn scaling(by: [f32; 3]) -> Transform {
    let [x, y, z] = by;
    [[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]]
}

/// A transform of a kind.
pub fn transform(kind: Kind, random: &mut Random) -> Transform {
    let power = |random: &mut Random, most: f64| 10f64.powf(random.between(-most, most)) as f32;
    let turned = rotation(random);
    let mut out = match kind {
        Kind::Ordinary | Kind::Coincident => {
            let scale = random.between(0.5, 1.5) as f32;
            product(&turned, &scaling([scale; 3]))
        }
        Kind::Scales => product(&turned, &scaling([power(random, 6.0); 3])),
        Kind::IllConditioned => {
            let scales = [power(random, 3.0), power(random, 1.0), -power(random, 0.5)];
            let sheared = product(&turned, &scaling(scales));
            match random.below(4) {
                0 => scaling(scales),
                1 => sheared,
                _ => product(&sheared, &rotation(random)),
            }
        }
        Kind::Far => turned,
        Kind::Wide => {
            let scale = 10f64.powf(random.between(-30.0, 30.0)) as f32;
            if random.below(2) == 0 {
                scaling([scale; 3])
            } else {
                product(&turned, &scaling([scale; 3]))
            }
        }
    };
    let reach = match kind {
        Kind::Far => 1e5,
        Kind::Scales => power(random, 4.0),
        Kind::Wide => power(random, 30.0),
        _ => 6.0,
    };
    for (row, by) in out.iter_mut().zip(random.point(reach)) {
        row[3] = by;
    }
    if kind == Kind::Coincident && random.below(2) == 0 {
        out = IDENTITY;
        out[0][3] = random.below(3) as f32;
    }
    out
}

/// A scene of a kind, and its instances.
pub fn scene(kind: Kind, instances: usize, seed: u64) -> (Scene, Vec<InstanceId>) {
    let mut random = Random::new(seed);
    let mut scene = Scene::new();
    let meshes = meshes(seed);
    let geometries: Vec<GeometryId> =
        meshes.iter().map(|mesh| scene.add_mesh(&mesh.mesh()).expect("a geometry")).collect();
    let mut all = Vec::new();
    while all.len() < instances {
        let geometry = random.pick(&geometries);
        let mut instance = Instance::new(geometry, transform(kind, &mut random));
        if random.below(8) == 0 {
            instance.mask = random.bits();
            instance.culling = random.pick(&[Culling::Back, Culling::Front, Culling::None]);
        }
        // Some transforms have no inverse.
        if let Ok(instance) = scene.add_instance(instance) {
            all.push(instance);
        }
    }
    (scene, all)
}

/// Adds sets of spheres and of capsules, in the place of a third of the instances: round ones of all sizes, some that are left out, and
/// capsules whose ends are one point, or far from one another.
pub fn add_shapes(scene: &mut Scene, instances: &[InstanceId], seed: u64) {
    let mut random = Random::new(seed);
    let point = |random: &mut Random| random.point(2.0);
    let radius = |random: &mut Random| match random.below(12) {
        0 => 0.0,
        1 => f32::NAN,
        _ => 10f64.powf(random.between(-3.0, 0.3)) as f32,
    };
    let spheres =
        (0..60).map(|_| Sphere { centre: point(&mut random), radius: radius(&mut random) });
    let spheres = Shapes::Spheres(spheres.collect());
    let capsules = (0..50).map(|number| {
        let first = point(&mut random);
        let second = match number % 4 {
            0 => first,
            1 => first.map(|x| x + 1e-12),
            2 => [first[0], first[1], first[2] + 1.5],
            _ => point(&mut random),
        };
        Capsule { ends: [first, second], radius: radius(&mut random) }
    });
    let capsules = Shapes::Capsules(capsules.collect());
    let one = Shapes::Capsules(vec![Capsule { ends: [[-0.5; 3], [0.5; 3]], radius: 0.75 }]);
    let sets = [spheres, capsules, one, Shapes::Spheres(Vec::new())]
        .map(|set| scene.add_shapes(set).expect("a geometry"));
    for (number, &name) in instances.iter().enumerate().filter(|(number, _)| number % 3 == 0) {
        let mut own = *scene.instance(name).expect("an instance");
        own.geometry = sets[number / 3 % sets.len()];
        scene.set_instance(name, own).expect("an edit");
    }
}

/// Gives every geometry but one an opacity mask, of levels from 0 on, about half of whose cells are opaque.
pub fn mask(scene: &mut Scene, seed: u64) {
    let mut random = Random::new(seed);
    let sizes: Vec<(GeometryId, usize)> =
        scene.geometries().map(|(name, own)| (name, own.mesh().len())).collect();
    for (number, (name, triangles)) in sizes.into_iter().enumerate().skip(1) {
        let level = number as u32 - 1;
        let is_opaque = |_, _| random.below(2) == 0;
        let mask = OpacityMask::new(triangles, level, is_opaque).expect("a mask");
        scene.set_opacity(name, Some(mask)).expect("an edit");
    }
}

/// A point of the world from the object's, in `f64`.
pub fn in_world(transform: &Transform, point: [f64; 3]) -> [f64; 3] {
    transform.map(|row| {
        let [a, b, c, d] = row.map(f64::from);
        a * point[0] + b * point[1] + c * point[2] + d
    })
}

/// Corners of all triangles in the world, rounded.
pub fn baked(scene: &Scene) -> Vec<[[f32; 3]; 3]> {
    let mut all = Vec::new();
    for (_, instance) in scene.instances() {
        let mesh = scene.geometry(instance.geometry).expect("a geometry");
        let mesh = mesh.mesh();
        let corners = |triangle| {
            let corners: [[f32; 3]; 3] = Mesh::triangle(&mesh, triangle);
            corners.map(|p| in_world(&instance.transform, p.map(f64::from)).map(|x| x as f32))
        };
        all.extend((0..mesh.len()).map(corners));
    }
    all
}

/// Rays for a scene: at vertices and triangles of random instances, along faces of their boxes and along axes, from near and
/// far, with limits.
pub fn rays(scene: &Scene, count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let instances: Vec<_> = scene.instances().map(|(_, instance)| *instance).collect();
    let target = |random: &mut Random| {
        let instance = random.pick(&instances);
        let mesh = scene.geometry(instance.geometry).expect("a geometry").clone();
        let mesh = mesh.mesh();
        if mesh.is_empty() {
            return (in_world(&instance.transform, [0.0; 3]), 1.0);
        }
        let corners = mesh.triangle(random.below(mesh.len()));
        let weights = match random.below(4) {
            0 => [1.0, 0.0, 0.0],
            1 => [0.5, 0.5, 0.0],
            _ => random.barycentric(),
        };
        let point = [0, 1, 2]
            .map(|k| (0..3).map(|corner| weights[corner] * f64::from(corners[corner][k])).sum());
        let size = instance.transform.iter().flat_map(|row| &row[..3]);
        let size = size.fold(0.0f32, |m, x| m.max(x.abs()));
        (in_world(&instance.transform, point), f64::from(size))
    };
    let mut all = Vec::with_capacity(count);
    while all.len() < count {
        let (to, size) = target(&mut random);
        let to32 = to.map(|x| x as f32);
        let ray = match random.below(8) {
            // Along an axis, through the point: in faces of boxes, with zeros of both signs.
            0 | 1 => {
                let axis = random.below(3);
                let zero = random.pick(&[0.0, -0.0]);
                let mut direction = [zero, 0.0, -zero];
                direction[axis] = random.pick(&[1.0, -1.0, 2.5]);
                let mut origin = to32;
                origin[axis] -= direction[axis] * size as f32 * random.pick(&[0.0, 2.0, 50.0]);
                Ray::new(origin, direction)
            }
            // From one object to another.
            2 | 3 => {
                let from = target(&mut random).0.map(|x| x as f32);
                Ray::segment(from, to32)
            }
            // From far away.
            4 => {
                let away = size * 10f64.powf(random.between(2.0, 6.0));
                let d = random.direction();
                let origin = [0, 1, 2].map(|k| (to[k] - d[k] * away) as f32);
                Ray::new(origin, d.map(|x| x as f32))
            }
            // From near by, with a direction of any length.
            _ => {
                let away = size * random.between(0.0, 4.0);
                let d = random.direction();
                let length = 10f64.powf(random.between(-3.0, 3.0));
                let origin = [0, 1, 2].map(|k| (to[k] - d[k] * away) as f32);
                Ray::new(origin, d.map(|x| (x * length) as f32))
            }
        };
        let ray = match random.below(6) {
            0 => ray.with_limits(f32::NEG_INFINITY, f32::INFINITY),
            1 => ray.with_limits(0.25, 1.5),
            _ => ray,
        };
        all.push(ray);
    }
    all
}
