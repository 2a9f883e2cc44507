//! Pictures of instances against pictures of one mesh in which everything stands where it is.

use crate::common::{self, ALL, Point, World, along_z, cornell, cornell_camera, shoot};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::{IDENTITY, Instance, Scene, Transform, translation};
use splitplane_cpu::CpuBackend;
use splitplane_render::instances::Geometries;
use splitplane_render::scene_data::NONE;
use splitplane_render::tracer::{FrameRequest, InstanceTracer, InstancedLook};
use splitplane_render::{Light, LightTransport, Material, Pinhole, RenderSettings, Size};

/// Triangles of geometries one after the other, and instances of them.
#[derive(Default)]
struct Parts {
    world: World,
    first_triangles: Vec<u32>,
    instances: Vec<(usize, Transform, u32)>,
}

impl Parts {
    /// Begins a geometry and gives its number.
    fn geometry(&mut self) -> usize {
        self.first_triangles.push(self.world.triangles.len() as u32);
        self.first_triangles.len() - 1
    }

    fn range(&self, geometry: usize) -> std::ops::Range<usize> {
        let end = self.first_triangles.get(geometry + 1).copied();
        let end = end.unwrap_or(self.world.triangles.len() as u32);
        self.first_triangles[geometry] as usize..end as usize
    }

    /// Gives all corners normals that lean away from the triangle's middle.
    fn lean(&mut self) {
        for corners in &self.world.triangles {
            let first = self.world.normals.len() as u32;
            let middle: Point = [0, 1, 2].map(|k| corners.iter().map(|c| c[k]).sum::<f32>() / 3.0);
            let [a, b, c] = corners.map(|c| c.map(f64::from));
            let normal = cross(sub(b, a), sub(c, a));
            let length = dot(normal, normal).sqrt();
            for corner in corners {
                self.world.normals.push(
                    [0, 1, 2].map(|k| (normal[k] / length) as f32 + 0.1 * (corner[k] - middle[k])),
                );
            }
            self.world.normal_indices.push([first, first + 1, first + 2]);
        }
    }

    fn shoot(&self, camera: Pinhole, size: Size, settings: &RenderSettings) -> Vec<[f32; 4]> {
        self.shoot_after(&self.instances, camera, size, settings)
    }

    /// The picture of a scene that had these instances, and was then updated to its own.
    fn shoot_after(
        &self,
        before: &[(usize, Transform, u32)],
        camera: Pinhole,
        size: Size,
        settings: &RenderSettings,
    ) -> Vec<[f32; 4]> {
        let mut scene = Scene::new();
        let names: Vec<_> = (0..self.first_triangles.len())
            .map(|geometry| {
                let mesh = Mesh::soup(&self.world.triangles[self.range(geometry)]).unwrap();
                scene.add_mesh(&mesh).unwrap()
            })
            .collect();
        let place = |(geometry, transform, _): &(usize, Transform, u32)| {
            Instance::new(names[*geometry], *transform)
        };
        let named: Vec<_> =
            before.iter().map(|own| scene.add_instance(place(own)).unwrap()).collect();
        let mesh = Mesh::soup(&self.world.triangles).unwrap();
        let of = |all: &[(usize, Transform, u32)]| all.iter().map(|(_, _, m)| *m).collect();
        let [materials_before, materials]: [Vec<u32>; 2] = [of(before), of(&self.instances)];
        let look = |materials| InstancedLook {
            mesh,
            appearance: self.world.appearance(),
            geometries: Geometries { first_triangles: &self.first_triangles, materials },
        };
        let options = BuildOptions::default();
        let backend = CpuBackend::new();
        let mut tracer =
            InstanceTracer::load(backend, &scene, &look(&materials_before), &options).unwrap();
        if before != self.instances {
            for (index, own) in self.instances.iter().enumerate() {
                match named.get(index) {
                    Some(name) => scene.set_instance(*name, place(own)).unwrap(),
                    None => assert_eq!(scene.add_instance(place(own)).unwrap().0, index as u32),
                }
            }
            for name in named.iter().skip(self.instances.len()) {
                scene.remove_instance(*name).unwrap();
            }
            tracer.update(&scene, &look(&materials), &options).unwrap();
        }
        let request =
            FrameRequest { settings: *settings, outputs: ALL, ..FrameRequest::new(camera, size) };
        tracer.frame(&mesh, &request).unwrap();
        // Costs are counted for every ray: who meets something has tested it.
        for (hit, cost) in tracer.first_hits().iter().zip(tracer.first_costs()) {
            assert!(hit.triangle == u32::MAX || (cost.triangles > 0 && cost.nodes > 0));
        }
        tracer.radiance().to_vec()
    }

    /// Everything where it is, in one mesh. Reflected triangles get their corners in the other order, so that their fronts stay.
    /// `normals` says how normals go into the world.
    fn baked(&self, normals: impl Fn(&Transform, Point) -> Point) -> World {
        let World { materials, lights, .. } = self.world.clone();
        let mut baked = World { materials, lights, ..World::default() };
        for (geometry, transform, material) in &self.instances {
            let mirrored = determinant(transform) < 0.0;
            let order = if mirrored { [0, 2, 1] } else { [0, 1, 2] };
            for triangle in self.range(*geometry) {
                let corners = self.world.triangles[triangle].map(|p| placed(transform, p));
                baked.triangles.push(order.map(|i| corners[i]));
                let own = self.world.material_of[triangle];
                baked.material_of.push(if *material == NONE { own } else { *material });
                if let Some(named) = self.world.normal_indices.get(triangle) {
                    let first = baked.normals.len() as u32;
                    for i in order {
                        let normal = self.world.normals[named[i] as usize];
                        baked.normals.push(normals(transform, normal));
                    }
                    baked.normal_indices.push([first, first + 1, first + 2]);
                }
            }
        }
        baked
    }
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn linear(transform: &Transform) -> [[f64; 3]; 3] {
    transform.map(|[a, b, c, _]| [a, b, c].map(f64::from))
}

fn determinant(transform: &Transform) -> f64 {
    let [a, b, c] = linear(transform);
    dot(a, cross(b, c))
}

fn placed(transform: &Transform, point: Point) -> Point {
    let p = point.map(f64::from);
    transform.map(|[a, b, c, d]| (dot([a, b, c].map(f64::from), p) + f64::from(d)) as f32)
}

/// By cofactors: the rows of the inverse's transpose, times the determinant, whose sign is kept.
fn by_cofactors(transform: &Transform, normal: Point) -> Point {
    let ([a, b, c], n) = (linear(transform), normal.map(f64::from));
    let sign = determinant(transform).signum();
    [cross(b, c), cross(c, a), cross(a, b)].map(|row| (sign * dot(row, n)) as f32)
}

/// What is wrong for all but rotations.
fn as_directions(transform: &Transform, normal: Point) -> Point {
    let n = normal.map(f64::from);
    linear(transform).map(|row| dot(row, n) as f32)
}

/// Floor, a stone, a mirror, a clear body and a lamp.
fn parts() -> Parts {
    let mut parts = Parts::default();
    parts.world.materials = vec![
        Material::new("white", [0.8; 3]),
        Material::new("steel", [0.2; 3]).with_mirror([0.6; 3]),
        Material::clay().with_dielectric(1.4, [0.9; 3]),
        Material::new("lamp", [0.0; 3]).with_emission([3.0, 2.0, 1.0]),
        Material::new("red", [0.8, 0.1, 0.1]),
    ];
    let position = [2.0, 4.0, 3.0];
    parts.world.lights = vec![Light::Point { position, irradiance: [2.0; 3], distance: 5.0 }];
    for (material, lo, hi) in [
        (0, [-20.0, -2.0, -20.0], [20.0, -1.0, 20.0]),
        (1, [-2.0, -1.0, -3.0], [-0.5, 0.8, -1.5]),
        (2, [0.2, -1.0, -2.0], [1.2, 0.4, -1.0]),
        (3, [-1.0, 3.0, -3.0], [1.0, 3.1, -1.0]),
    ] {
        parts.geometry();
        parts.world.block(material, lo, hi);
    }
    parts
}

fn settings() -> RenderSettings {
    RenderSettings { samples: 2, area_samples: 2, depth: 6, ..RenderSettings::default() }
}

fn view() -> (Pinhole, Size) {
    let size = Size::new(96, 64).unwrap();
    (along_z([0.0, 0.3, 3.0], size, 0.7), size)
}

/// Part of the pixels in which two pictures differ by more than a hundredth.
fn differing(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let differs = |(a, b): (&[f32; 4], &[f32; 4])| {
        (0..3).any(|k| (a[k] - b[k]).abs() > 0.01 * (1.0 + a[k].abs()))
    };
    a.iter().zip(b).filter(|pair| differs(*pair)).count() as f64 / a.len() as f64
}

#[test]
fn instances_in_place_are_the_picture_of_a_mesh_bit_for_bit() {
    let ((camera, size), settings) = (view(), settings());
    for smooth in [false, true] {
        let mut parts = parts();
        if smooth {
            parts.lean();
        }
        parts.instances = (0..4).map(|geometry| (geometry, IDENTITY, NONE)).collect();
        let whole = shoot(&parts.world, camera, size, &settings);
        let picture = parts.shoot(camera, size, &settings);
        let bits = |radiance: &[[f32; 4]]| {
            radiance.as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<u32>>()
        };
        assert!(bits(whole.renderer.radiance()) == bits(&picture), "smooth: {smooth}");
        // A part that is not there is missed.
        parts.instances.truncate(3);
        assert!(differing(&parts.shoot(camera, size, &settings), &picture) > 0.05);
    }
}

/// A scene that is updated looks like one that is loaded: lamps come, go, move, and take the place of what is none.
#[test]
fn lamps_that_come_and_go_with_an_update_are_those_of_a_scene_loaded_anew() {
    let ((camera, size), settings) = (view(), settings());
    let mut parts = parts();
    let moved = translation([0.5, -0.75, 0.25]);
    let others: Vec<_> = (0..3).map(|geometry| (geometry, IDENTITY, NONE)).collect();
    let with = |more: &[(usize, Transform, u32)]| [&others[..], more].concat();
    let none = with(&[]);
    let lamp = with(&[(3, IDENTITY, NONE)]);
    let elsewhere = with(&[(3, moved, NONE)]);
    let two = with(&[(3, IDENTITY, NONE), (1, moved, 3)]);
    let painted = with(&[(3, IDENTITY, 0)]);
    let mut pictures = Vec::new();
    for (before, now) in [
        (&none, &lamp),
        (&lamp, &elsewhere),
        (&elsewhere, &two),
        (&two, &painted),
        (&painted, &lamp),
        (&lamp, &none),
    ] {
        parts.instances.clone_from(now);
        let loaded = parts.shoot(camera, size, &settings);
        let updated = parts.shoot_after(before, camera, size, &settings);
        let bits = |picture: &[[f32; 4]]| {
            picture.as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<u32>>()
        };
        assert!(bits(&loaded) == bits(&updated), "{before:?} to {now:?}");
        pictures.push(loaded);
    }
    // The lamp is seen by what it lights.
    assert!(pictures.windows(2).all(|two| differing(&two[0], &two[1]) > 0.05));
}

/// Turned, stretched, sheared and reflected, with smooth normals, glass, mirrors and a lamp that is moved.
#[test]
fn placed_instances_look_like_a_mesh_that_stands_there() {
    let ((camera, size), settings) = (view(), settings());
    let mut parts = parts();
    parts.lean();
    let turned = [[0.8, 0.0, 0.6, 0.9], [0.1, 1.4, 0.0, 0.3], [-0.6, 0.0, 0.8, -0.7]];
    let reflected = [[-1.0, 0.2, 0.0, 0.4], [0.0, 0.7, 0.0, -0.1], [0.0, 0.0, 1.6, 0.8]];
    parts.instances = vec![
        (0, IDENTITY, NONE),
        (1, turned, NONE),
        (1, reflected, 4),
        (2, reflected, NONE),
        (2, turned, NONE),
        (3, translation([0.5, -0.75, 0.25]), NONE),
    ];
    let picture = parts.shoot(camera, size, &settings);
    let baked = shoot(&parts.baked(by_cofactors), camera, size, &settings);
    let off = differing(baked.renderer.radiance(), &picture);
    assert!(off < 0.004, "{off}");
    let wrong = shoot(&parts.baked(as_directions), camera, size, &settings);
    let off = differing(wrong.renderer.radiance(), &picture);
    assert!(off > 0.02, "normals that go through the transform itself are noticed: {off}");
}

/// A scene that is moved far away and seen from there, and one that is shrunk: no surface shades itself.
#[test]
fn distance_and_size_do_not_make_surfaces_shade_themselves() {
    let settings = RenderSettings { samples: 1, area_samples: 0, ..settings() };
    let (camera, size) = view();
    let mut parts = parts();
    parts.instances = (0..3).map(|geometry| (geometry, IDENTITY, NONE)).collect();
    let near = parts.shoot(camera, size, &settings);
    for by in [1024.0, -4096.0] {
        let moved = translation([by, by, -by]);
        parts.instances.iter_mut().for_each(|(_, transform, _)| *transform = moved);
        let eye = [0, 1, 2].map(|k| camera.eye[k] + moved[k][3]);
        let [x, y, z] = [2.0, 4.0, 3.0];
        parts.world.lights = vec![Light::Point {
            position: [x + by, y + by, z - by],
            irradiance: [2.0; 3],
            distance: 5.0,
        }];
        let far = parts.shoot(Pinhole { eye, ..camera }, size, &settings);
        let off = differing(&near, &far);
        assert!(off < 0.02, "{by}: {off}");
    }
}

#[test]
fn triangles_that_are_not_described_are_refused() {
    let parts = parts();
    let mut scene = Scene::new();
    let mesh = Mesh::soup(&parts.world.triangles).unwrap();
    let geometry = scene.add_mesh(&mesh).unwrap();
    scene.add_instance(Instance::in_place(geometry)).unwrap();
    for first_triangles in [&[][..], &[1]] {
        let geometries = Geometries { first_triangles, materials: &[] };
        let look = InstancedLook { mesh, appearance: parts.world.appearance(), geometries };
        let options = BuildOptions::default();
        let refused = InstanceTracer::load(CpuBackend::new(), &scene, &look, &options).unwrap_err();
        assert!(refused.to_string().contains("geometry 0"), "{refused}");
    }
}

/// Photons go through instances as through one mesh: the same room as one instance where it is gives the same bits, and one that is made of
/// two, the second of which stands elsewhere, the same light.
#[test]
fn photons_in_a_scene_of_instances() {
    let size = Size::new(16, 12).unwrap();
    let settings = RenderSettings {
        light: LightTransport::Photons,
        photons: 100_000,
        samples: 8,
        passes: 2,
        ..common::dark()
    };
    let room = cornell();
    let mesh = shoot(&room, cornell_camera(size), size, &settings);
    let instances = vec![(0, IDENTITY, NONE)];
    let parts = Parts { world: room.clone(), first_triangles: vec![0], instances };
    let one = parts.shoot(cornell_camera(size), size, &settings);
    assert_eq!(mesh.renderer.radiance(), one);
    // The block of the room, its last twelve triangles, made two to the left and brought back.
    let block = room.triangles.len() - 12;
    let mut parts = Parts { first_triangles: vec![0, block as u32], ..Parts::default() };
    parts.world = room.clone();
    for corners in &mut parts.world.triangles[block..] {
        corners.iter_mut().for_each(|corner| corner[0] -= 2.0);
    }
    parts.instances = vec![(0, IDENTITY, NONE), (1, translation([2.0, 0.0, 0.0]), NONE)];
    let two = parts.shoot(cornell_camera(size), size, &settings);
    let mean = |picture: &[[f32; 4]]| {
        picture.iter().map(|pixel| f64::from(pixel[0] + pixel[1])).sum::<f64>()
    };
    let (one, two) = (mean(&one), mean(&two));
    assert!((one / two - 1.0).abs() < 0.003, "{one} {two}");
}
