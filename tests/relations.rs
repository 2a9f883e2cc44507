//! What must not change when a scene is scaled by a power of two, turned, mirrored or moved: needs no
//! oracle, since two answers of the same program are compared.
//!
//! - *Scaling by powers of two* changes no tree but by that factor, and no hit but in `t`: nothing
//!   rounds otherwise, as long as nothing leaves the range in which the documents promise it.
//! - *Exchanging and mirroring axes* changes neither triangle nor `t` of accuracy `exact`. Watertight
//!   hits keep every bit when axes are mirrored, as long as the direction has one largest component: the
//!   shear goes along it, and of two equal ones the lower axis is taken. When axes change places, sums
//!   over the axes are rounded in another order where `t` comes from the plane equation (grazing or
//!   very near triangles); then, as with two largest components, the judge's bounds hold.
//! - *Moving by what keeps all coordinates exact* changes no hit. What rounds coordinates keeps the
//!   order of hits that are further apart than the rounding.

use crate::common::bits;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::{KdNode, NodeKind};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::extremes;
use splitplane_test_support::judge::{Judge, PLACE};
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};

fn build(scene: &Scene, preset: Preset) -> CpuAccelerator {
    let options = BuildOptions::from(preset.config());
    CpuBackend::new().build_accelerator(&scene.mesh(), &options).expect("a tree")
}

fn options(accuracy: Accuracy) -> QueryOptions<'static> {
    QueryOptions { accuracy, ..QueryOptions::default() }
}

fn closest(built: &CpuAccelerator, rays: &[Ray], options: &QueryOptions<'_>) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    built.closest_hits(rays, &mut hits, options).expect("equal lengths");
    hits
}

fn subjects() -> Vec<Scene> {
    let all = [
        scenes::soup(700, 0.15, 71),
        scenes::nested_spheres(),
        scenes::seams(true),
        scenes::grid_boxes(3),
        scenes::needles(200),
        scenes::fan(500),
        scenes::stairs(12),
        extremes::stack(60, true),
    ];
    all.map(|scene| mapped(&scene, |p| p.map(without_noise))).into()
}

fn mixed_rays(scene: &Scene, each: usize, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays: Vec<Ray> =
        Kind::ALL.iter().flat_map(|&kind| aim::rays(&mesh, kind, each, seed)).collect();
    rays.extend(extremes::along(&mesh, each, seed + 1));
    for ray in &mut rays {
        (ray.origin, ray.direction) =
            (ray.origin.map(without_noise), ray.direction.map(without_noise));
        if ray.direction == [0.0; 3] {
            ray.direction = [1.0, -2.0, 3.0];
        }
    }
    rays
}

/// Zero for what is nothing but the rounding of a zero: scaled down it would be snapped.
fn without_noise(x: f32) -> f32 {
    if x.abs() < 1e-6 { 0.0 } else { x }
}

/// The scene with every position mapped.
fn mapped(scene: &Scene, map: impl Fn([f32; 3]) -> [f32; 3]) -> Scene {
    let mut scene = scene.clone();
    scene.positions.iter_mut().for_each(|p| *p = map(*p));
    scene
}

fn scaled_tree(tree: &KdTree, factor: f32) -> KdTree {
    let mut scaled = tree.clone();
    for node in &mut scaled.nodes {
        if let NodeKind::Interior { axis, split, right } = node.kind() {
            *node = KdNode::interior(axis, split * factor, right);
        }
    }
    for x in scaled.bounds.lo.iter_mut().chain(&mut scaled.bounds.hi) {
        *x *= factor;
    }
    scaled
}

#[test]
fn trees_scale_by_powers_of_two() {
    let mut nodes = 0;
    for scene in subjects() {
        for preset in Preset::ALL {
            let tree = build(&scene, preset).tree().clone();
            nodes += tree.nodes.len();
            for exponent in [-70, -41, -17, -3, -1, 1, 6, 23, 50, 90, 110] {
                let factor = 2f32.powi(exponent);
                let larger = scenes::scaled(&scene, factor, &scene.name);
                let found = build(&larger, preset).tree().clone();
                let expected = scaled_tree(&tree, factor);
                let what = format!("{}, {} times 2^{exponent}", scene.name, preset.name());
                assert_eq!(found.bounds, expected.bounds, "{what}");
                assert!(found.nodes == expected.nodes, "{what}: the nodes differ");
                assert!(found.references == expected.references, "{what}: the references differ");
            }
        }
    }
    assert!(nodes > 6_000, "{nodes}");
}

#[test]
fn hits_scale_by_powers_of_two() {
    let mut seen = 0;
    for scene in subjects() {
        let rays = mixed_rays(&scene, 40, 3);
        for preset in Preset::ALL {
            let built = build(&scene, preset);
            for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
                let base = closest(&built, &rays, &options(accuracy));
                // Beyond these, coordinates or sizes leave the plain test's range, and another one
                // runs; `exact` has no such range.
                let exponents: &[i32] = match accuracy {
                    Accuracy::Exact => &[-80, -50, -11, -1, 2, 9, 33, 80],
                    _ => &[-11, -1, 2, 9, 24],
                };
                for &exponent in exponents {
                    let factor = 2f32.powi(exponent);
                    let other = build(&scenes::scaled(&scene, factor, &scene.name), preset);
                    // Directions by another power than positions: `t` takes up the quotient.
                    let by = 2f32.powi((exponent / 3).clamp(-6, 6));
                    let scaled: Vec<Ray> = rays
                        .iter()
                        .map(|ray| Ray {
                            origin: ray.origin.map(|x| x * factor),
                            direction: ray.direction.map(|x| x * by),
                            ..*ray
                        })
                        .collect();
                    let hits = closest(&other, &scaled, &options(accuracy));
                    for (i, (hit, base)) in hits.iter().zip(&base).enumerate() {
                        let expected = Hit { t: base.t * (factor / by), ..*base };
                        assert_eq!(
                            bits(hit),
                            bits(&expected),
                            "{}, {}, {accuracy:?}, times 2^{exponent}: {:?} gives {hit:?}, not {expected:?}",
                            scene.name,
                            preset.name(),
                            rays[i]
                        );
                        seen += usize::from(hit.is_hit());
                    }
                }
            }
        }
    }
    assert!(seen > 40_000, "{seen}");
}

/// An exchange of axes, some of them mirrored.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// Where each new axis comes from.
    from: [usize; 3],
    /// With which sign.
    sign: [f32; 3],
}

impl Turn {
    /// All 48 but the one that changes nothing.
    fn all() -> Vec<Turn> {
        let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]];
        let mut all = Vec::new();
        for from in orders {
            for mask in 0..8 {
                let sign = [0, 1, 2].map(|axis| if mask >> axis & 1 == 1 { -1.0 } else { 1.0 });
                all.push(Turn { from, sign });
            }
        }
        all.remove(0);
        all
    }

    fn apply(&self, p: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.sign[axis] * p[self.from[axis]])
    }

    /// Whether left and right change places, and so front and back of every triangle.
    fn mirrors(&self) -> bool {
        let even = matches!(self.from, [0, 1, 2] | [1, 2, 0] | [2, 0, 1]);
        even == (self.sign.iter().product::<f32>() < 0.0)
    }

    fn ray(&self, ray: &Ray) -> Ray {
        Ray { origin: self.apply(ray.origin), direction: self.apply(ray.direction), ..*ray }
    }
}

/// Whether one component of the direction is larger than both others.
fn has_main_axis(ray: &Ray) -> bool {
    let mut sizes = ray.direction.map(f32::abs);
    sizes.sort_by(f32::total_cmp);
    sizes[1] < sizes[2]
}

#[test]
fn hits_do_not_depend_on_the_axes() {
    let (mut equal, mut judged, mut hit_exactly) = (0, 0, 0);
    for scene in subjects() {
        let rays = mixed_rays(&scene, 12, 5);
        let turns = Turn::all();
        let mut others = 0;
        for (number, preset) in Preset::ALL.into_iter().enumerate() {
            let built = build(&scene, preset);
            for culling in [Culling::None, Culling::Back] {
                let base = [Accuracy::Watertight, Accuracy::Exact].map(|accuracy| {
                    closest(&built, &rays, &QueryOptions { culling, ..options(accuracy) })
                });
                // A third of the turns for each preset.
                for turn in turns.iter().skip(number).step_by(3) {
                    let turned = mapped(&scene, |p| turn.apply(p));
                    let other = build(&turned, preset);
                    let sides = match culling {
                        Culling::Back if turn.mirrors() => Culling::Front,
                        same => same,
                    };
                    let turned_rays: Vec<Ray> = rays.iter().map(|ray| turn.ray(ray)).collect();
                    let found = [Accuracy::Watertight, Accuracy::Exact].map(|accuracy| {
                        let options = QueryOptions { culling: sides, ..options(accuracy) };
                        closest(&other, &turned_rays, &options)
                    });
                    let mesh = turned.mesh();
                    let oracle = Oracle::new(&mesh);
                    let judge = Judge::new(&mesh, &oracle);
                    for (i, ray) in rays.iter().enumerate() {
                        let what = || {
                            let (name, preset) = (&scene.name, preset.name());
                            format!("{name}, {preset}, {culling:?}, {turn:?}: {ray:?}")
                        };
                        let exact = [&found[1][i], &base[1][i]];
                        assert_eq!(exact[0].triangle, exact[1].triangle, "exact, {}", what());
                        assert_eq!(exact[0].t.to_bits(), exact[1].t.to_bits(), "exact, {}", what());
                        hit_exactly += usize::from(exact[0].is_hit());
                        let same = bits(&found[0][i]) == bits(&base[0][i]);
                        if has_main_axis(ray) && turn.from == [0, 1, 2] {
                            assert!(same, "{}: {:?}, not {:?}", what(), found[0][i], base[0][i]);
                            equal += 1;
                        } else if !same {
                            others += usize::from(has_main_axis(ray));
                            let options =
                                QueryOptions { culling: sides, ..options(Accuracy::Watertight) };
                            let hit = found[0][i].some();
                            if let Err(why) = judge.closest(&turned_rays[i], &options, hit) {
                                panic!("{}: {why}", what());
                            }
                            judged += 1;
                        }
                    }
                }
            }
        }
        let cast = rays.len() * turns.len() * 2;
        assert!(others * 50 <= cast, "{}: {others} of {cast} differ", scene.name);
    }
    // Sums over the axes are rounded in another order where `t` comes from a triangle's plane: seldom to another float.
    assert!(equal > 5_000 && hit_exactly > 10_000, "{equal} {judged} {hit_exactly}");
}

/// A scene and rays on a grid of 2^-8, within 8 of the origin.
fn on_a_grid(scene: &Scene, rays: &[Ray]) -> (Scene, Vec<Ray>) {
    let round = |x: f32| ((x * 256.0).round() / 256.0).clamp(-8.0, 8.0);
    let rays = rays.iter().map(|ray| {
        let [origin, direction] = [ray.origin, ray.direction].map(|p| p.map(round));
        Ray { origin, direction: if direction == [0.0; 3] { [1.0; 3] } else { direction }, ..*ray }
    });
    (mapped(scene, |p| p.map(round)), rays.collect())
}

#[test]
fn hits_do_not_depend_on_the_place() {
    let mut seen = 0;
    for scene in subjects() {
        let (scene, rays) = on_a_grid(&scene, &mixed_rays(&scene, 40, 7));
        for preset in Preset::ALL {
            let built = build(&scene, preset);
            for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
                let base = closest(&built, &rays, &options(accuracy));
                for by in [[1.0, 0.0, 0.0], [-40.5, 300.25, 7.0], [12_000.0, -9_000.5, 16_000.25]] {
                    let shift = |p: [f32; 3]| {
                        let moved = [0, 1, 2].map(|axis| p[axis] + by[axis]);
                        for axis in 0..3 {
                            let exact = f64::from(p[axis]) + f64::from(by[axis]);
                            assert_eq!(f64::from(moved[axis]), exact, "the move rounds");
                        }
                        moved
                    };
                    let other = build(&mapped(&scene, shift), preset);
                    let moved: Vec<Ray> =
                        rays.iter().map(|ray| Ray { origin: shift(ray.origin), ..*ray }).collect();
                    for (i, hit) in closest(&other, &moved, &options(accuracy)).iter().enumerate() {
                        assert_eq!(
                            bits(hit),
                            bits(&base[i]),
                            "{}, {}, {accuracy:?}, moved by {by:?}: {:?}",
                            scene.name,
                            preset.name(),
                            rays[i]
                        );
                        seen += usize::from(hit.is_hit());
                    }
                }
            }
        }
    }
    assert!(seen > 15_000, "{seen}");
}

/// All hits of a ray in the order in which a program finds them that asks for the next one again and
/// again.
fn in_turn(built: &CpuAccelerator, ray: &Ray, options: &QueryOptions<'_>) -> Vec<Hit> {
    let mut found = Vec::new();
    let mut from = *ray;
    while let Some(hit) = built.closest_hit(&from, options) {
        found.push(hit);
        from = from.with_limits(hit.t.next_up(), from.t_max);
        assert!(found.len() < 10_000, "no end");
    }
    found
}

/// Moving by any amount rounds corners and origin by at most half a unit in the last place of where
/// they then are, `r`. A plane met at an angle of sine `s` then moves by at most 2 sqrt(3) r / s along
/// the ray, and the test errs by its own bound. Hits further apart stay in order.
#[test]
fn the_order_of_hits_survives_moves_that_round() {
    let mut random = Random::new(8);
    let (mut compared, mut moved_apart) = (0, 0);
    for scene in [scenes::soup(300, 0.4, 72), scenes::nested_spheres(), scenes::stairs(20)] {
        let mesh = scene.mesh();
        let rays: Vec<Ray> = [Kind::Random, Kind::Faces, Kind::Edges]
            .iter()
            .flat_map(|&kind| aim::rays(&mesh, kind, 80, 9))
            .collect();
        for preset in Preset::ALL {
            let built = build(&scene, preset);
            for distance in [10.0, 1e3, 1e5] {
                let way = random.direction().map(|x| x * distance);
                let shift =
                    |p: [f32; 3]| [0, 1, 2].map(|axis| (f64::from(p[axis]) + way[axis]) as f32);
                let other = build(&mapped(&scene, shift), preset);
                for ray in &rays {
                    let there = Ray { origin: shift(ray.origin), ..*ray };
                    let length = ray.direction.iter().map(|x| x * x).sum::<f32>().sqrt();
                    let options = options(Accuracy::Watertight);
                    // Only what is met at a decent angle, by an angle's sine of at least 0.2.
                    let steep = |hit: &&Hit| {
                        let [a, b, c] = mesh.triangle(hit.triangle as usize);
                        let [e, f] = [b, c].map(|p| [0, 1, 2].map(|i| p[i] - a[i]));
                        let n = [0, 1, 2].map(|i| {
                            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                            e[j] * f[k] - e[k] * f[j]
                        });
                        let dot: f32 = (0..3).map(|i| n[i] * ray.direction[i]).sum();
                        dot.abs() > 0.2 * length * n.iter().map(|x| x * x).sum::<f32>().sqrt()
                    };
                    let here: Vec<Hit> =
                        in_turn(&built, ray, &options).iter().filter(steep).copied().collect();
                    let after = in_turn(&other, &there, &options);
                    let reach = 8.0 + distance;
                    let rounding = f64::from(f32::EPSILON) / 2.0;
                    let bound = (2.0 * 3f64.sqrt() * rounding * reach + PLACE * rounding * 10.0)
                        / (0.2 * f64::from(length));
                    let place = |hit: &Hit| after.iter().position(|h| h.triangle == hit.triangle);
                    for (i, first) in here.iter().enumerate() {
                        for second in &here[i + 1..] {
                            if f64::from(second.t) - f64::from(first.t) <= 2.0 * bound {
                                moved_apart += 1;
                                continue;
                            }
                            if let (Some(p), Some(q)) = (place(first), place(second)) {
                                assert!(p < q, "{}, {distance}: {ray:?}", scene.name);
                                compared += 1;
                            }
                        }
                    }
                }
            }
        }
    }
    assert!(compared > 10_000, "{compared} compared, {moved_apart} too close");
}
