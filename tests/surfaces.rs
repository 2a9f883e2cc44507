//! Rays that run along surfaces: in the planes of triangles, along edges, from inside closed surfaces past their own
//! faces. What they hit depends on ray and mesh alone.
//!
//! About a million rays are answered by the core's reference traversal over a tree of one leaf, and asked of every
//! preset, layout and instruction set: closest hits and any hit, each in one of three ways (one ray a call, a batch
//! of neighbours, a batch in random order), which take turns. `splitplane-surfaces` does the same for longer. The
//! checks are those of `splitplane_test_support::surfaces`; each is seen to fail on backends with a planted fault.

use std::sync::OnceLock;

use rayon::prelude::*;
use splitplane_core::backend::{Backend, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::faulty::{Fault, FaultyBackend};
use splitplane_test_support::grazing::{Kind, Shape, Surface, Volley};
use splitplane_test_support::scenes::parse_obj;
use splitplane_test_support::surfaces::{
    Asked, OneLeaf, QueryMode, Tally, ask, compare, examine, judge, ray_of, seed_of, volleys,
};

/// A way to make what is asked.
struct Configuration {
    backend: Box<dyn Backend>,
    options: BuildOptions<'static>,
    name: [String; 3],
}

/// Every preset, layout and instruction set.
fn configurations() -> Vec<Configuration> {
    let mut all = Vec::new();
    for set in InstructionSet::available() {
        for layout in [QueryLayout::Fast, QueryLayout::Compact] {
            for preset in Preset::ALL {
                all.push(Configuration {
                    backend: Box::new(CpuBackend::with_instruction_set(set)),
                    options: BuildOptions { layout, ..preset.config().into() },
                    name: [
                        format!("preset {}", preset.name()),
                        format!("layout {}", layout.name()),
                        format!("set {}", set.name()),
                    ],
                });
            }
        }
    }
    all
}

/// One configuration with a fault.
fn faulty(fault: Fault) -> Configuration {
    let backend = FaultyBackend::new(CpuBackend::new(), fault);
    let name = ["preset fast", "layout fast", "set faulty"].map(str::to_owned);
    Configuration { backend: Box::new(backend), options: BuildOptions::default(), name }
}

/// Asks every configuration for volleys at a surface.
fn examine_surface(surface: &Surface, volleys: &[Volley], asked: &[Configuration]) -> Tally {
    let (mesh, triangles) = (surface.scene.mesh(), surface.scene.triangles());
    let one_leaf = OneLeaf::new(&mesh);
    let accelerators: Vec<_> = asked
        .iter()
        .map(|Configuration { backend, options, name }| {
            backend.build(&mesh, options).unwrap_or_else(|error| panic!("{name:?}: {error}"))
        })
        .collect();
    let mut tally = Tally { surfaces: 1, ..Tally::default() };
    for (turn, volley) in volleys.iter().enumerate() {
        let expected = one_leaf.closest(&volley.rays, &volley.options);
        let contradictions = one_leaf.contradictions(volley, &expected);
        assert_eq!(contradictions, Vec::<usize>::new(), "of the reference, {:?}", surface.seed);
        let ways: Vec<[QueryMode; 2]> = (0..asked.len())
            .map(|i| {
                let turn = turn + i + surface.seed as usize;
                [QueryMode::CLOSEST[turn % 3], QueryMode::ANY[(turn / 3) % 3]]
            })
            .collect();
        let asked: Vec<Asked<'_>> = asked
            .iter()
            .zip(&accelerators)
            .zip(&ways)
            .map(|((of, accelerator), ways)| Asked {
                name: &of.name,
                accelerator: &**accelerator,
                ways,
            })
            .collect();
        tally.add(examine(surface, &triangles, volley, &expected, &asked));
    }
    tally
}

/// Surfaces of every shape, so many of each, and so many rays of each kind at each.
fn examine_all(count: u64, each: usize, configurations: fn() -> Vec<Configuration>) -> Tally {
    let surfaces: Vec<(u64, Shape)> =
        (0..count * Shape::ALL.len() as u64).zip(Shape::ALL.into_iter().cycle()).collect();
    let tallies: Vec<Tally> = surfaces
        .par_iter()
        .map_init(configurations, |asked, &(number, shape)| {
            let surface = Surface::new(shape, seed_of(1, number));
            examine_surface(&surface, &volleys(&surface, each), asked)
        })
        .collect();
    let mut total = Tally::default();
    tallies.into_iter().for_each(|tally| total.add(tally));
    total
}

/// What all rays came to; the checks each look at a part.
fn tally() -> &'static Tally {
    static TALLY: OnceLock<Tally> = OnceLock::new();
    TALLY.get_or_init(|| {
        let tally = examine_all(24, 400, configurations);
        assert!(tally.rays > 950_000, "{tally}");
        assert!(tally.hits * 2 > tally.rays, "{tally}");
        assert!(tally.inside > 250_000, "{tally}");
        tally
    })
}

#[track_caller]
fn passes(verdict: Result<(), String>) {
    verdict.unwrap_or_else(|report| panic!("{report}"));
}

/// Both limits are included: a query for hits that are not before a hit, or not after it, returns
/// that hit again.
#[test]
fn limits_at_a_hit_include_it() {
    let mut asked = 0;
    for (number, shape) in Shape::ALL.into_iter().cycle().take(4 * Shape::ALL.len()).enumerate() {
        let surface = Surface::new(shape, seed_of(5, number as u64));
        let mesh = surface.scene.mesh();
        let options = BuildOptions::from(Preset::ALL[number % Preset::ALL.len()]);
        let tree = CpuBackend::new().build_accelerator(&mesh, &options).expect("a tree");
        for volley in volleys(&surface, 200) {
            let hits = ask(&tree, &volley.rays, &volley.options, QueryMode::Together, 0);
            for from in [true, false] {
                let (mut rays, mut expected) = (Vec::new(), Vec::new());
                for (ray, hit) in volley.rays.iter().zip(&hits).filter(|(_, hit)| hit.is_hit()) {
                    let limits = if from { (hit.t, ray.t_max) } else { (ray.t_min, hit.t) };
                    rays.push(ray.with_limits(limits.0, limits.1));
                    expected.push(*hit);
                }
                let again = ask(&tree, &rays, &volley.options, QueryMode::Shuffled, number as u64);
                for ((ray, expected), found) in rays.iter().zip(&expected).zip(&again) {
                    assert_eq!(found, expected, "{shape:?} {number}: {ray:?}");
                }
                asked += rays.len();
            }
        }
    }
    assert!(asked > 50_000, "{asked}");
}

#[test]
fn closest_hits_depend_on_ray_and_mesh_alone() {
    passes(tally().closest_hits_agree());
}

#[test]
fn any_hit_is_there_where_a_closest_one_is() {
    passes(tally().any_hits_agree());
}

#[test]
fn no_ray_gets_out_of_a_closed_surface() {
    passes(tally().none_is_lost());
}

#[test]
fn hits_name_points_of_their_triangles() {
    passes(tally().hits_are_sound());
}

/// Rays that were once answered differently, as files and words: a box from which one got out, a sphere at which
/// presets differed, a sheet at which instruction sets did.
#[test]
fn rays_that_were_once_answered_wrongly() {
    let reproducers = [
        (
            Shape::Warped,
            include_str!("surfaces/box.obj"),
            [0xbf5cdafa, 0xbdda3ff3, 0xbbf0f3e5, 0x3e0e4529, 0xbe3025f8, 0xbe04661a],
        ),
        (
            Shape::LatLong,
            include_str!("surfaces/s11.obj"),
            [0xbf761514, 0x3d828e7a, 0x3f5ffe6e, 0x3f479568, 0xbf1f6d8c, 0xbd871588],
        ),
        (
            Shape::Heights,
            include_str!("surfaces/isa.obj"),
            [0xbe4f3305, 0x3f81bd28, 0x3f605f25, 0x3c7e9ba5, 0xbc9cd9bf, 0xbd207baa],
        ),
    ];
    let mut total = Tally::default();
    for (shape, text, [ox, oy, oz, dx, dy, dz]) in reproducers {
        let surface = Surface::of(parse_obj(shape.name(), text), shape);
        let ray = ray_of([ox, oy, oz, dx, dy, dz, 0, f32::INFINITY.to_bits()]);
        // Alone, and as a packet. Of the rays only that in the box is inside, but all have something to hit.
        for count in [1, 64] {
            let (kind, rays) = (Kind::Inside, vec![ray; count]);
            let volley = Volley { kind, rays, options: QueryOptions::default() };
            // Three times, so that each configuration is asked for closest hits in each way.
            total.add(examine_surface(&surface, &vec![volley; 3], &configurations()));
        }
    }
    assert_eq!((total.rays, total.inside), (3 * 3 * 65, 3 * 3 * 65));
    passes(total.all_is_well());
}

/// What must find a fault.
type Check = fn(&Tally) -> Result<(), String>;

/// Each check fails on the backend with the fault that it is for, and passes on the same rays without it.
#[test]
fn planted_faults_are_found() {
    let checks: [(Fault, &[Check]); 10] = [
        (Fault::Leak, &[Tally::closest_hits_agree, Tally::any_hits_agree, Tally::none_is_lost]),
        (Fault::HigherIndexWins, &[Tally::closest_hits_agree]),
        (Fault::OpenInterval, &[Tally::closest_hits_agree, Tally::any_hits_agree]),
        (Fault::NoCulling, &[Tally::closest_hits_agree, Tally::any_hits_agree]),
        (Fault::NoIgnore, &[Tally::closest_hits_agree]),
        (Fault::SecondHit, &[Tally::closest_hits_agree]),
        (Fault::ForgetsLast, &[Tally::closest_hits_agree, Tally::none_is_lost]),
        (Fault::AnyHitDisagrees, &[Tally::any_hits_agree]),
        (Fault::WrongWeights, &[Tally::closest_hits_agree]),
        (Fault::Phantom, &[Tally::closest_hits_agree, Tally::any_hits_agree]),
    ];
    for (fault, checks) in checks {
        let (mut sane, mut broken) = (Tally::default(), Tally::default());
        for shape in Shape::ALL {
            let surface = Surface::new(shape, 7);
            let volleys = volleys(&surface, 120);
            let whole = [Configuration { backend: Box::new(CpuBackend::new()), ..faulty(fault) }];
            sane.add(examine_surface(&surface, &volleys, &whole));
            broken.add(examine_surface(&surface, &volleys, &[faulty(fault)]));
        }
        for check in checks {
            passes(check(&sane));
            assert!(check(&broken).is_err(), "{fault:?} is not found: {broken}");
        }
    }
}

/// Hits that are not sound are found where a backend gives them.
#[test]
fn planted_hits_are_found() {
    let judged = |backend: &dyn Backend| {
        let mut tally = Tally::default();
        for shape in Shape::ALL {
            let surface = Surface::new(shape, 7);
            let mesh = surface.scene.mesh();
            let built = backend.build(&mesh, &BuildOptions::default()).expect("a tree");
            for volley in volleys(&surface, 60) {
                let hits = ask(&*built, &volley.rays, &volley.options, QueryMode::Together, 0);
                tally.add(judge(&surface, &surface.scene.triangles(), &volley, &hits));
            }
        }
        tally
    };
    passes(judged(&CpuBackend::new()).hits_are_sound());
    for fault in [Fault::WrongDistance, Fault::WrongWeights, Fault::NoLimits] {
        let tally = judged(&FaultyBackend::new(CpuBackend::new(), fault));
        assert!(tally.hits_are_sound().is_err(), "{fault:?} is not found: {tally}");
    }
}

/// Answers of another ray's are found, in every way of asking.
#[test]
fn every_way_of_asking_is_compared() {
    let surface = Surface::new(Shape::City, 3);
    let mesh = surface.scene.mesh();
    let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree");
    let volley = &volleys(&surface, 40)[0];
    for way in QueryMode::CLOSEST.into_iter().chain(QueryMode::ANY) {
        let name = ["cpu".to_owned()];
        let asked = [Asked { name: &name, accelerator: &*built, ways: &[way] }];
        let right = ask(&*built, &volley.rays, &volley.options, QueryMode::Singly, 0);
        let tally = compare(&surface, volley, &right, &asked);
        assert_eq!((tally.answers, tally.different, tally.disagreeing), (40, 0, 0), "{way:?}");
        let mut wrong = right.clone();
        let of = wrong.iter().position(Hit::is_hit).expect("a hit");
        wrong[of] = Hit::MISS;
        let tally = compare(&surface, volley, &wrong, &asked);
        assert_eq!(tally.different + tally.disagreeing, 1, "{way:?}");
    }
    let far: Ray = Ray::new([1e30; 3], [1.0; 3]);
    assert_eq!(ask(&*built, &[far], &volley.options, QueryMode::Singly, 0), [Hit::MISS]);
}
