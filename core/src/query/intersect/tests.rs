use super::prepare::scale;
use super::*;
use crate::aabb::Aabb;
use crate::arithmetic::{Hostile, Strict, power_of_two};
use crate::ray::{Culling, Ray};
use crate::triangle::Triangle;

const TRIANGLE: Triangle = [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, -1.0]];

fn scene(triangles: &[Triangle]) -> SceneScale {
    let bounds = Aabb::of_points(triangles.as_flattened());
    let limits = triangles.iter().fold(Limits::NONE, |l, t| l.union(Limits::of(t)));
    SceneScale::new(bounds, &limits)
}

fn hit(triangle: &Triangle, ray: &Ray, culling: Culling) -> Option<f32> {
    let prepared = PreparedRay::new::<Strict>(ray, &scene(&[*triangle]))?;
    let hit = watertight::<Strict>(&prepared, triangle, culling)?;
    let hostile = PreparedRay::new::<Hostile>(ray, &scene(&[*triangle]))?;
    assert_eq!(watertight::<Hostile>(&hostile, triangle, culling), Some(hit));
    prepared.outer_t::<Strict>(hit.t)
}

#[test]
fn front_is_where_corners_run_counter_clockwise() {
    let front = Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -4.0]);
    let back = Ray::new([0.25, 0.25, -2.0], [0.0, 0.0, 0.5]);
    assert_eq!(hit(&TRIANGLE, &front, Culling::None), Some(0.5));
    assert_eq!(hit(&TRIANGLE, &back, Culling::None), Some(2.0));
    assert_eq!(hit(&TRIANGLE, &front, Culling::Back), Some(0.5));
    assert_eq!(hit(&TRIANGLE, &front, Culling::Front), None);
    assert_eq!(hit(&TRIANGLE, &back, Culling::Back), None);
    assert_eq!(hit(&TRIANGLE, &back, Culling::Front), Some(2.0));
    let prepared = PreparedRay::new::<Strict>(&front, &scene(&[TRIANGLE])).unwrap();
    for culling in [Culling::None, Culling::Back, Culling::Front] {
        let fast = moeller_trumbore::<Strict>(&prepared, &TRIANGLE, culling);
        assert_eq!(fast.is_some(), culling != Culling::Front);
    }
}

#[test]
fn weights_belong_to_the_second_and_third_corner() {
    let ray = Ray::new([0.5, 0.125, 3.0], [0.0, 0.0, -1.0]);
    let prepared = PreparedRay::new::<Strict>(&ray, &scene(&[TRIANGLE])).unwrap();
    let hit = watertight::<Strict>(&prepared, &TRIANGLE, Culling::None).unwrap();
    assert_eq!((hit.u, hit.v), (0.5, 0.125));
}

#[test]
fn limits_are_closed() {
    let ray =
        |t_min, t_max| Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -4.0]).with_limits(t_min, t_max);
    assert_eq!(hit(&TRIANGLE, &ray(0.5, 0.5), Culling::None), Some(0.5));
    assert_eq!(hit(&TRIANGLE, &ray(0.5f32.next_up(), 1.0), Culling::None), None);
    assert_eq!(hit(&TRIANGLE, &ray(-1.0, 0.5f32.next_down()), Culling::None), None);
}

#[test]
fn every_scale_gives_the_same_hit() {
    for power in (-120..=120).step_by(8) {
        let triangle = TRIANGLE.map(|corner| corner.map(|x| scale(x, power)));
        let ray = Ray::new([0.25, 0.25, 1.0].map(|x| scale(x, power)), [0.0, 0.0, -4.0]);
        assert_eq!(hit(&triangle, &ray, Culling::None), Some(scale(0.5, power)), "2^{power}");
    }
}

#[test]
fn directions_of_any_length_serve() {
    for power in (-126..=127).step_by(11) {
        let length = power_of_two(power);
        let ray = Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -length]);
        let expected = scale(2.0, -power);
        assert_eq!(hit(&TRIANGLE, &ray, Culling::None), Some(expected), "2^{power}");
    }
}

#[test]
fn far_origins_are_moved_without_losing_the_way() {
    for distance in [1e3f32, 1e5, 1e7, 1e12] {
        let ray = Ray::new([0.25, 0.25, distance], [0.0, 0.0, -1.0]);
        let t = hit(&TRIANGLE, &ray, Culling::None).unwrap();
        assert_eq!(t, distance + 1.0);
    }
}

#[test]
fn a_point_just_above_a_huge_triangle_is_above_it() {
    // A tilted triangle 3,000 units wide, seen from 0.001 above: interpolation alone would err
    // by more than that.
    let triangle = [[-1500.0, -0.05, -1200.0], [1500.0, 0.3, -1100.0], [37.0, 0.1, 1300.0]];
    for k in 0..100 {
        let (u, v) = (0.1 + 0.008 * k as f64, 0.05);
        let point: [f64; 3] = core::array::from_fn(|i| {
            let [a, b, c] = triangle.map(|p: [f32; 3]| f64::from(p[i]));
            a + u * (b - a) + v * (c - a)
        });
        let origin = [point[0] as f32, (point[1] + 0.001) as f32, point[2] as f32];
        let ray = Ray::new(origin, [0.3, -1.0, 0.2]);
        let t = hit(&triangle, &ray, Culling::None).expect("above");
        assert!(t > 0.0 && t < 0.002, "{t}");
    }
}

#[test]
fn rays_that_can_hit_nothing() {
    let none = |ray: Ray| PreparedRay::new::<Strict>(&ray, &scene(&[TRIANGLE])).is_none();
    let good = Ray::new([0.0; 3], [1.0, 0.0, 0.0]);
    assert!(!none(good));
    assert!(none(Ray { direction: [0.0, -0.0, 1e-40], ..good }));
    assert!(none(Ray { direction: [f32::NAN, 0.0, 1.0], ..good }));
    assert!(none(Ray { origin: [f32::INFINITY, 0.0, 1.0], ..good }));
    assert!(none(good.with_limits(1.0, 0.5)));
    assert!(none(good.with_limits(f32::NAN, 1.0)));
    assert!(none(good.with_limits(0.0, f32::NAN)));
    assert!(!none(good.with_limits(f32::NEG_INFINITY, f32::INFINITY)));
}

/// Rays that start in the planes of triangles with coordinates of very different magnitude: the
/// remainder of the distance is subnormal in part, which devices may flush.
#[test]
fn what_devices_flush_decides_nothing() {
    let unit = [[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [1.0, 2.0, 1.0]];
    let cases: [(Triangle, [f32; 3], [f32; 3]); 8] = [
        (
            [
                [1.296_891_7e-5, 0.0, 1.787_583e-12],
                [-2.368_901_3e-14, 0.0, -2.828_894_2e-9],
                [-2.731_21e-5, -8.282_862e-17, -2.575_207_8e-7],
            ],
            [9.446_495_7e-7, -2.221_083e-17, -6.932_082e-8],
            [-0.336_521_5, -1.0, -0.001_837_440_1],
        ),
        (
            [
                [0.000_174_318_51, -3.909_292_4e-26, -3.371_315e-18],
                [1.659_195_2e-15, -2.246_652_6e-7, -2.981_770_8e-19],
                [-4.470_06e-14, 3.567_222_8e-29, -2.951_371_6e-19],
            ],
            [6.660_374_5e-5, -5.717_767_6e-8, -1.471_259e-18],
            [-1.0, -0.001_186_293_1, -0.406_640_32],
        ),
        (
            [
                [2.206_956e-5, 1.773_700_8e-19, -6.103_556_4e-20],
                [1.499_559_7e-20, -5.003_901e-17, -7.861_559e-5],
                [-2.101_149_4e-16, -5.796_769_2e-18, -1.664_631_1e-6],
            ],
            [5.051_542e-6, -2.087_974_6e-17, -2.989_596_2e-5],
            [0.964_189_05, 0.508_616_1, -1.0],
        ),
        (
            [
                [1.179_923_7e-25, 3.367_261e-28, -1.304_043_5e-8],
                [0.000_466_221_42, 4.126_317e-17, -3.978_457e-21],
                [-1.667_296_8e-6, -7.623_129_7e-28, 2.476_986_1e-18],
            ],
            [0.000_223_637_12, 1.982_482_4e-17, -3.670_120_4e-9],
            [-0.837_724_9, 1.0, -1.014_738_1e-5],
        ),
        (
            [
                [0.0, 0.0, 2.538_244_2e-5],
                [0.0, 0.0, 5.906_67e-11],
                [-8.430_592e-8, -4.675_483_2e-17, -4.667_038_2e-5],
            ],
            [-2.546_839e-9, -1.412_439_7e-18, 1.041_208_2e-5],
            [-0.000_551_108, -0.601_141_04, -1.0],
        ),
        (
            [
                [0.0, -4.396_654_6e-25, 0.0],
                [0.0, 8.369_924_3e-16, 5.404_207e-25],
                [8.568_517_4e-19, 2.997_867e-15, 2.978_544_1e-15],
            ],
            [0.0, -4.396_654_6e-25, 0.0],
            [2.197_758_3e-4, 1.0, 0.763_973_53],
        ),
        (
            [
                [2.285_671_3e-14, 2.548_272_7e-20, 1.0],
                [-1.687_072e-21, -4.461_815_8e-26, 1.0],
                [-8.663_771_7e-16, -2.756_798_7e-25, 1.0],
            ],
            [-1.687_072e-21, -4.461_815_8e-26, 1.0],
            [0.0, 0.019_263_387, -3.717_451e-8],
        ),
        (
            [
                [3.736_693_5e-22, 8.449_597e-18, 0.0],
                [-2.702_281_8e-13, 2.691_047e-11, 0.0],
                [-5.444_563_4e-24, 8.264_639_3e-26, 0.0],
            ],
            [3.736_693_5e-22, 8.449_597e-18, 0.0],
            [0.522_397_4, 0.0, -0.260_141_13],
        ),
    ];
    for (triangle, origin, direction) in cases {
        let (scene, ray) = (scene(&[triangle, unit]), Ray::new(origin, direction));
        let strict = PreparedRay::new::<Strict>(&ray, &scene).expect("a ray");
        let hostile = PreparedRay::new::<Hostile>(&ray, &scene).expect("a ray");
        let hit = watertight::<Strict>(&strict, &triangle, Culling::None);
        assert!(hit.is_some(), "{ray:?}");
        assert_eq!(watertight::<Hostile>(&hostile, &triangle, Culling::None), hit, "{ray:?}");
    }
}
