use super::prepare::scale;
use super::*;
use crate::aabb::Aabb;
use crate::arithmetic::{Hostile, Strict, power_of_two};
use crate::random;
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

/// Whole numbers by chance, the same each time.
struct Draws(u64, u64);

impl Draws {
    /// One of so many, from 0.
    fn below(&mut self, count: u64) -> i64 {
        self.1 += 1;
        (random::hash(self.0, &[self.1]) % count) as i64
    }

    fn point(&mut self) -> [i64; 3] {
        [(); 3].map(|()| self.below(7) - 3)
    }
}

fn minus([a, b, c]: [i64; 3], [d, e, f]: [i64; 3]) -> [i64; 3] {
    [a - d, b - e, c - f]
}

fn dot([a, b, c]: [i64; 3], [d, e, f]: [i64; 3]) -> i64 {
    a * d + b * e + c * f
}

fn cross([a, b, c]: [i64; 3], [d, e, f]: [i64; 3]) -> [i64; 3] {
    [b * f - c * e, c * d - a * f, a * e - b * d]
}

/// Where a line meets a triangle between whole numbers, edges and corners included: distance and weights of all corners, and
/// whether from the front. By the plane's equation and three areas in the plane.
fn counted(
    origin: [i64; 3],
    direction: [i64; 3],
    [a, b, c]: [[i64; 3]; 3],
) -> Option<(f64, [f64; 3], bool)> {
    let normal = cross(minus(b, a), minus(c, a));
    let (numerator, denominator) = (dot(normal, minus(a, origin)), dot(normal, direction));
    if denominator == 0 {
        return None;
    }
    // The point, and with it all corners, times the denominator.
    let point = [0, 1, 2].map(|k| origin[k] * denominator + direction[k] * numerator);
    let areas = [(b, c), (c, a), (a, b)].map(|(from, to)| {
        let away = minus(point, from.map(|x| x * denominator));
        dot(cross(minus(to, from), away), normal) * denominator.signum()
    });
    let whole = (dot(normal, normal) * denominator.abs()) as f64;
    let weights = areas.map(|area| area as f64 / whole);
    let met = areas.iter().all(|&area| area >= 0);
    met.then_some((numerator as f64 / denominator as f64, weights, denominator < 0))
}

/// Rays whose slopes are powers of two leave nothing to round in the image of a triangle between whole numbers: it is met
/// where the triangle is, edges and corners included, at any scale.
#[test]
fn whole_numbers_are_met_where_counting_says() {
    let (mut met, mut edges, mut limited) = (0, 0, 0);
    for round in 0..12_000 {
        let mut draws = Draws(17, 100 * round);
        let (origin, corners) = (draws.point(), [draws.point(), draws.point(), draws.point()]);
        let direction = [(); 3].map(|()| [0, 1, -1, 2, -2, 4, -4][draws.below(7) as usize]);
        if direction == [0; 3] {
            continue;
        }
        let culling = [Culling::None, Culling::Back, Culling::Front][draws.below(3) as usize];
        // Not where hits are, but between them.
        let limits = [(); 2].map(|()| draws.below(10) as f32 - 3.0 + 1.0 / 1024.0);
        let limits = if draws.below(3) > 0 { [-100.0, 100.0] } else { limits };
        let expected = counted(origin, direction, corners);
        if expected.is_some_and(|(t, ..)| limits.iter().any(|&x| (f64::from(x) - t).abs() < 1e-3)) {
            continue;
        }
        let is_met = |(t, _, front): &(f64, [f64; 3], bool)| {
            let culled = match culling {
                Culling::None => false,
                Culling::Back => !front,
                Culling::Front => *front,
            };
            let within = f64::from(limits[0]) <= *t && *t <= f64::from(limits[1]);
            limited += u32::from(!within);
            !culled && within
        };
        let expected = expected.filter(is_met);
        // In range, in tiny scenes and in huge ones.
        for power in [0, -7, 20, -60, 60, -100, 100] {
            let place = |p: [i64; 3]| p.map(|x| scale(x as f32, power));
            let triangle = corners.map(place);
            let [t_min, t_max] = limits.map(|t| scale(t, power));
            let ray = Ray::new(place(origin), direction.map(|x| x as f32));
            let ray = ray.with_limits(t_min, t_max);
            let context = (ray, triangle);
            let found =
                PreparedRay::new::<Strict>(&ray, &scene(&[triangle])).and_then(|prepared| {
                    let hit = watertight::<Strict>(&prepared, &triangle, culling)?;
                    let t = prepared.outer_t::<Strict>(hit.t)?;
                    Some((f64::from(scale(t, -power)), f64::from(hit.u), f64::from(hit.v)))
                });
            let hostile =
                PreparedRay::new::<Hostile>(&ray, &scene(&[triangle])).and_then(|prepared| {
                    let hit = watertight::<Hostile>(&prepared, &triangle, culling)?;
                    let t = prepared.outer_t::<Hostile>(hit.t)?;
                    Some((f64::from(scale(t, -power)), f64::from(hit.u), f64::from(hit.v)))
                });
            assert_eq!(hostile, found, "{context:?}");
            let (Some((t, [_, v, w], _)), Some(hit)) = (expected, found) else {
                assert_eq!(found.is_some(), expected.is_some(), "{context:?}");
                continue;
            };
            assert!((hit.0 - t).abs() <= t.abs() / 8192.0 + 1e-5, "{context:?} {t} {hit:?}");
            let off = (hit.1 - v).abs().max((hit.2 - w).abs());
            assert!(off < 1.0 / 2048.0, "{context:?} {v} {w} {hit:?}");
        }
        let Some((t, weights, _)) = expected else { continue };
        met += 1;
        edges += u32::from(weights.contains(&0.0));
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9 && t.is_finite());
    }
    assert!(met > 200 && edges > 80 && limited > 40, "{met} {edges} {limited}");
}

/// The fast test answers the same but next to edges.
#[test]
fn the_fast_test_agrees_off_the_edges() {
    let mut answers = [0; 2];
    for round in 0..20_000 {
        let mut draws = Draws(23, 100 * round);
        let (origin, direction) = (draws.point(), draws.point());
        let corners = [draws.point(), draws.point(), draws.point()];
        let culling = [Culling::None, Culling::Back, Culling::Front][draws.below(3) as usize];
        let t_min = draws.below(7) as f32 - 3.001;
        if direction == [0; 3] {
            continue;
        }
        let expected = counted(origin, direction, corners);
        let edge = |(t, weights, _): (f64, [f64; 3], bool)| {
            weights.iter().any(|x| x.abs() < 1e-5) || (t - f64::from(t_min)).abs() < 1e-5
        };
        if expected.is_some_and(edge) {
            continue;
        }
        let float = |p: [i64; 3]| p.map(|x| x as f32);
        let triangle = corners.map(float);
        let ray = Ray::new(float(origin), float(direction)).with_limits(t_min, 3.001);
        let Some(prepared) = PreparedRay::new::<Strict>(&ray, &scene(&[triangle])) else {
            continue;
        };
        let hit = moeller_trumbore::<Strict>(&prepared, &triangle, culling);
        let expected = expected.filter(|&(t, _, front)| {
            let culled = culling == Culling::Back && !front || culling == Culling::Front && front;
            !culled && f64::from(t_min) <= t && t <= 3.001
        });
        assert_eq!(hit.is_some(), expected.is_some(), "{ray:?} {triangle:?}");
        answers[usize::from(hit.is_some())] += 1;
        if let (Some(hit), Some((t, [_, v, w], _))) = (hit, expected) {
            let outer = f64::from(prepared.outer_t::<Strict>(hit.t).expect("within the limits"));
            let off = [outer - t, f64::from(hit.u) - v, f64::from(hit.v) - w];
            assert!(off.iter().all(|x| x.abs() < 1e-5), "{ray:?} {triangle:?} {off:?}");
        }
    }
    assert!(answers.iter().all(|&count| count > 100), "{answers:?}");
}

/// A far origin is moved along the axis on which it is farthest off; of equals along the first.
#[test]
fn far_origins_are_moved_to_the_farthest_side() {
    let bounds = Aabb { lo: [-1.0; 3], hi: [1.0; 3] };
    let scene =
        SceneScale::new(bounds, &Limits { greatest: 1.0, least: 1.0, longest: 2.0, shortest: 2.0 });
    for (origin, axis) in [
        ([1025.0f32, 1025.0, 1025.0], 0),
        ([0.0, 1025.0, 1025.0], 1),
        ([1024.0, 0.0, 1025.0], 2),
        ([-1025.0, 1025.0, 0.0], 0),
        ([-1025.0, 2049.0, -2049.0], 1),
    ] {
        // Each axis comes to its side after another distance.
        let direction = [0, 1, 2].map(|k| -origin[k].signum() * [1.0, 0.5, 0.25][k]);
        let direction = [0, 1, 2].map(|k| if origin[k] == 0.0 { 0.0 } else { direction[k] });
        let prepared = PreparedRay::new::<Strict>(&Ray::new(origin, direction), &scene).unwrap();
        let way = (origin[axis].abs() - 1.0) / direction[axis].abs();
        let outer = prepared.outer_t::<Strict>(0.0);
        assert_eq!(outer, Some(way), "{origin:?}");
        let arrived = [0, 1, 2].map(|k| origin[k] + way * direction[k]);
        for k in 0..3 {
            let off = (prepared.origin[k] - arrived[k]).abs();
            // An origin of 0 may stand a little beside it.
            assert!(off <= ORIGIN_LEAST, "{origin:?} {prepared:?}");
        }
        assert_eq!(prepared.origin[axis], origin[axis].signum());
    }
    // Within a hundred extents nothing is moved; far off on an axis on which it stays, a ray meets nothing.
    let near = Ray::new([200.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
    assert_eq!(PreparedRay::new::<Strict>(&near, &scene).unwrap().offset, 0.0);
    let beside = Ray::new([0.0, 0.0, 300.0], [-1.0, 0.0, 0.0]);
    assert!(PreparedRay::new::<Strict>(&beside, &scene).is_none());
}

/// Wide enough and not much wider.
#[test]
fn widened_boxes_have_the_slack_of_their_triangles() {
    for round in 0..1_000 {
        let mut draws = Draws(5, 100 * round);
        let mut float = || {
            (draws.below(1 << 20) - (1 << 19)) as f32 * power_of_two(draws.below(40) as i32 - 30)
        };
        let (one, other, longest) =
            ([float(), float(), float()], [float(), float(), float()], float().abs());
        let part = Aabb::of_points(&[one, other]);
        let wide = widened(&part, longest);
        let slack = f64::from(longest) / f64::from(1 << 18);
        for k in 0..3 {
            for (from, to, side) in [(part.lo[k], wide.lo[k], -1.0), (part.hi[k], wide.hi[k], 1.0)]
            {
                let moved = side * (f64::from(to) - f64::from(from));
                // Two roundings of the greater end.
                let rounding = 4.0 * f64::from(f32::EPSILON) * f64::from(from.abs().max(to.abs()));
                assert!(
                    moved >= slack && moved <= slack + rounding + 1e-44,
                    "{part:?} {longest} {wide:?}"
                );
            }
        }
    }
    let all = widened(&Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] }, f32::MAX);
    assert_eq!(all, Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] });
}
