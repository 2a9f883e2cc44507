//! Counts what a backend gets wrong: rays aimed where tracers leak, sent from inside and outside of
//! closed meshes near the origin and far from it, each answer compared with the exact oracle.
//!
//! A ray that the oracle says hits and the backend says misses is counted as *missed*, whatever
//! accounts for it. Those that rounding next to an outline of the mesh does not account for are
//! also counted as *holes*: the ray went through the surface.

use crate::aim::{self, Aim};
use crate::judge::{Judge, Verdict};
use crate::oracle::Oracle;
use crate::random::Random;
use crate::scenes::Scene;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};

/// What rays are aimed at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Anything: directions, or points within the bounds, at random.
    Random,
    /// Points of edges; every other ray holds the middle of an edge without rounding, where that
    /// can be.
    Edges,
    /// Vertices; every other ray holds its vertex without rounding, where that can be.
    Vertices,
}

impl Target {
    /// All of them.
    pub const ALL: [Target; 3] = [Target::Random, Target::Edges, Target::Vertices];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Target::Random => "random",
            Target::Edges => "edges",
            Target::Vertices => "vertices",
        }
    }
}

/// Where mesh and rays are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The mesh where it was made, about the origin; rays start within two sizes of it.
    Near,
    /// The mesh moved 1e3 to 1e7 times its size from the origin, its corners rounded there.
    Far,
    /// The mesh where it was made; rays start 1e3 to 1e7 times its size away.
    Distant,
}

impl Place {
    /// All of them.
    pub const ALL: [Place; 3] = [Place::Near, Place::Far, Place::Distant];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Place::Near => "near",
            Place::Far => "far",
            Place::Distant => "distant",
        }
    }

    /// How many times its size the mesh is moved, one after the other.
    pub const fn moves(self) -> &'static [f64] {
        match self {
            Place::Far => &[1e3, 1e4, 1e5, 1e6, 1e7],
            Place::Near | Place::Distant => &[0.0],
        }
    }
}

/// From which side rays come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// From a ball within the mesh, or from anywhere within its bounds where no ball is known.
    Inside,
    /// From around its bounds.
    Outside,
}

impl Side {
    /// Both.
    pub const ALL: [Side; 2] = [Side::Inside, Side::Outside];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Side::Inside => "inside",
            Side::Outside => "outside",
        }
    }
}

/// A mesh to shoot at.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The mesh.
    pub scene: Scene,
    /// Centre and radius of a ball that lies within, if one is known.
    pub ball: Option<([f64; 3], f64)>,
    /// Longest extent of the bounds.
    pub size: f64,
}

impl Subject {
    /// A mesh, and a ball within it.
    pub fn new(scene: Scene, ball: Option<([f64; 3], f64)>) -> Subject {
        let bounds = crate::oracle::finite_bounds(&scene.mesh());
        let extent = |axis: usize| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis]);
        let size = (0..3).map(extent).fold(0.0, f64::max);
        Subject { scene, ball, size }
    }

    /// The same, `sizes` times its size from where it is, in a direction that is no axis; corners
    /// are rounded there.
    #[must_use]
    pub fn moved(&self, sizes: f64) -> Subject {
        if sizes == 0.0 {
            return self.clone();
        }
        let way = [0.6, -0.31, 0.737].map(|x: f64| x * sizes * self.size);
        let shift = |p: [f64; 3]| [0, 1, 2].map(|axis| p[axis] + way[axis]);
        let mut scene = self.scene.clone();
        for position in &mut scene.positions {
            *position = shift(position.map(f64::from)).map(|x| x as f32);
        }
        let ball = self.ball.map(|(centre, radius)| (shift(centre), radius));
        Subject { scene, ball, size: self.size }
    }
}

/// Where a set of rays comes from and goes to.
#[derive(Clone, Copy, Debug)]
pub struct Shots {
    /// What rays are aimed at.
    pub target: Target,
    /// Where mesh and rays are.
    pub place: Place,
    /// From which side.
    pub side: Side,
}

impl Shots {
    /// `count` rays at a mesh, which is already at its place. `aim` is of that mesh; equal seeds
    /// give equal rays.
    pub fn rays(&self, subject: &Subject, aim: &Aim<'_>, count: usize, seed: u64) -> Vec<Ray> {
        let mut aim = aim.with_seed(seed);
        (0..count).map(|number| self.ray(subject, &mut aim, number % 2 == 0)).collect()
    }

    fn ray(&self, subject: &Subject, aim: &mut Aim<'_>, exact: bool) -> Ray {
        let origin = self.origin(subject, aim);
        let rounded = origin.map(clamp);
        match self.target {
            Target::Random if self.side == Side::Inside => {
                let away = aim.random().direction();
                let target = [0, 1, 2].map(|i| f64::from(rounded[i]) + subject.size * away[i]);
                aim::aimed(rounded, target)
            }
            Target::Random => aim::aimed(rounded, point_within(subject, aim)),
            Target::Edges => {
                let [a, b] = aim.edge().map(|p| p.map(f64::from));
                if exact {
                    let middle = [0, 1, 2].map(|i| (a[i] + b[i]) / 2.0);
                    let target = middle.map(|x| x as f32);
                    let ray = (target.map(f64::from) == middle)
                        .then(|| aim::exactly_from(origin, target))
                        .flatten();
                    if let Some(ray) = ray {
                        return ray;
                    }
                }
                let s = aim.random().unit();
                aim::aimed(rounded, [0, 1, 2].map(|i| a[i] * (1.0 - s) + b[i] * s))
            }
            Target::Vertices => {
                let target = aim.corner();
                let ray = exact.then(|| aim::exactly_from(origin, target)).flatten();
                ray.unwrap_or_else(|| aim::aimed(rounded, target.map(f64::from)))
            }
        }
    }

    fn origin(&self, subject: &Subject, aim: &mut Aim<'_>) -> [f64; 3] {
        let bounds = aim.bounds();
        let centre = [0, 1, 2].map(|i| 0.5 * (f64::from(bounds.lo[i]) + f64::from(bounds.hi[i])));
        let random = aim.random();
        if self.place == Place::Distant {
            let distance = subject.size * 10f64.powf(random.between(3.0, 7.0));
            let away = random.direction();
            return [0, 1, 2].map(|i| centre[i] + distance * away[i]);
        }
        match (self.side, subject.ball) {
            (Side::Inside, Some((centre, radius))) => {
                let away = random.direction();
                let reach = radius * random.unit().cbrt();
                [0, 1, 2].map(|i| centre[i] + reach * away[i])
            }
            (Side::Inside, None) => point_within(subject, aim),
            (Side::Outside, _) => {
                // Beyond the corners of the bounds, up to two sizes away.
                let away = random.direction();
                let reach = subject.size * random.between(0.9, 2.0);
                [0, 1, 2].map(|i| centre[i] + reach * away[i])
            }
        }
    }
}

/// A point of the ball within, or of the bounds.
fn point_within(subject: &Subject, aim: &mut Aim<'_>) -> [f64; 3] {
    let bounds = aim.bounds();
    let random: &mut Random = aim.random();
    match subject.ball {
        Some((centre, radius)) => {
            let away = random.direction();
            let reach = radius * random.unit().cbrt();
            [0, 1, 2].map(|i| centre[i] + reach * away[i])
        }
        None => [0, 1, 2].map(|i| random.between(f64::from(bounds.lo[i]), f64::from(bounds.hi[i]))),
    }
}

fn clamp(x: f64) -> f32 {
    x.clamp(-f64::from(f32::MAX), f64::from(f32::MAX)) as f32
}

/// What was counted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Rays traced.
    pub rays: u64,
    /// Rays that hit by the oracle.
    pub hits: u64,
    /// Rays that hit by the oracle and not by the backend, whatever accounts for it.
    pub missed: u64,
    /// Of these, rays that no outline of the mesh accounts for: they went through the surface.
    pub holes: u64,
    /// Rays that hit by the backend and not by the oracle.
    pub phantoms: u64,
    /// Hits on a triangle that the oracle does not meet there.
    pub others: u64,
    /// Hits that rounding does not account for: too far off in distance or place, phantoms and
    /// hits on other triangles among them.
    pub wrong: u64,
    /// Rays at several triangles at exactly the same distance; of accuracy exact only, where they are
    /// looked for.
    pub ties: u64,
    /// Answers that are not the oracle's to the bit: another triangle than the lowest index at the
    /// least distance, or another float than the nearest to that distance; of accuracy exact only.
    pub inexact: u64,
    /// Of these, rays on which the triangle differs, or one side misses.
    pub inexact_triangle: u64,
    /// Rays on which any hit contradicts the closest hit.
    pub contradictions: u64,
    /// The first ray missed, hole or wrong answer, in words.
    pub first: Option<String>,
}

impl Tally {
    /// Adds another's counts.
    pub fn add(&mut self, other: &Tally) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.missed += other.missed;
        self.holes += other.holes;
        self.phantoms += other.phantoms;
        self.others += other.others;
        self.wrong += other.wrong;
        self.ties += other.ties;
        self.inexact += other.inexact;
        self.inexact_triangle += other.inexact_triangle;
        self.contradictions += other.contradictions;
        if self.first.is_none() {
            self.first.clone_from(&other.first);
        }
    }
}

/// Compares answers with the oracle's.
pub struct Counter<'a> {
    oracle: &'a Oracle,
    judge: Judge<'a>,
    options: QueryOptions<'a>,
}

impl<'a> Counter<'a> {
    /// A counter for one mesh and its oracle.
    pub fn new(mesh: &Mesh<'a>, oracle: &'a Oracle, options: QueryOptions<'a>) -> Counter<'a> {
        Counter { oracle, judge: Judge::new(mesh, oracle), options }
    }

    /// Compares a batch; `occluded` are the answers of any hit, where they were asked for.
    pub fn count(&self, rays: &[Ray], hits: &[Hit], occluded: Option<&[bool]>) -> Tally {
        let mut tally = Tally::default();
        for (i, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            self.one(ray, hit, &mut tally);
            tally.contradictions += u64::from(occluded.is_some_and(|any| any[i] != hit.is_hit()));
        }
        tally
    }

    /// Counts an answer that needs no exact comparison of distances: a miss of both, or one of the
    /// triangles that the oracle finds first, or as good as first, at its distance. False, and nothing
    /// counted, for others.
    fn is_clear(&self, ray: &Ray, hit: &Hit, tally: &mut Tally) -> bool {
        let crossings = self.oracle.crossings_unsorted(ray, &self.options);
        let within = || crossings.iter().filter(|c| c.is_within(ray));
        let Some(first) = within().map(|c| c.t).min_by(f64::total_cmp) else {
            tally.rays += u64::from(!hit.is_hit());
            return !hit.is_hit();
        };
        let near = |t: f64| (t - first).abs() <= first.abs() * 2f64.powi(-20);
        let met = within().any(|c| c.triangle == hit.triangle && near(c.t));
        let clear = hit.is_hit() && met && near(f64::from(hit.t));
        if clear {
            tally.rays += 1;
            tally.hits += 1;
        }
        clear
    }

    fn one(&self, ray: &Ray, hit: &Hit, tally: &mut Tally) {
        if self.options.accuracy != Accuracy::Exact && self.is_clear(ray, hit, tally) {
            return;
        }
        let exact_wanted = self.options.accuracy == Accuracy::Exact;
        tally.rays += 1;
        let crossings = self.oracle.crossings(ray, &self.options);
        let mut within = crossings.iter().filter(|c| c.is_within(ray));
        let best = within.next();
        let tied: Vec<u32> = match best {
            Some(best) => std::iter::once(best)
                .chain(within.take_while(|other| other.compare_t(best).is_eq()))
                .map(|crossing| crossing.triangle)
                .collect(),
            None => Vec::new(),
        };
        tally.hits += u64::from(best.is_some());
        tally.ties += u64::from(exact_wanted && tied.len() > 1);
        let expected = best.map(|best| (best.rounded_t(), *tied.iter().min().unwrap_or(&0)));
        let given = hit.some().map(|hit| (hit.t, hit.triangle));
        if exact_wanted
            && given.map(|(t, k)| ((t + 0.0).to_bits(), k))
                != expected.map(|(t, k)| (t.to_bits(), k))
        {
            tally.inexact += 1;
            tally.inexact_triangle += u64::from(given.map(|g| g.1) != expected.map(|e| e.1));
        }
        let clear = match (given, expected) {
            (None, None) => return,
            (Some((t, triangle)), Some((exact, _))) => {
                let same = tied.contains(&triangle);
                tally.others += u64::from(!same);
                same && (t - exact).abs() <= exact.abs() * 2f32.powi(-20)
            }
            (None, Some(_)) => {
                tally.missed += 1;
                false
            }
            (Some(_), None) => {
                tally.phantoms += 1;
                false
            }
        };
        if clear {
            return;
        }
        match self.judge.closest(ray, &self.options, hit.some()) {
            Err(reason) => {
                if given.is_none() {
                    tally.holes += 1;
                } else {
                    tally.wrong += 1;
                }
                // What is wrong is worth more than what was missed beside an outline.
                tally.first = Some(reason);
            }
            Ok(Verdict::Same | Verdict::SameDistance | Verdict::Rounding) => {
                if given.is_none() && tally.first.is_none() {
                    tally.first = Some(format!("missed beside an outline: {ray:?}"));
                }
            }
        }
    }
}
