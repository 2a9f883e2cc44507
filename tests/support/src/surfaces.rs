//! What is demanded of answers to rays that run along surfaces ([`grazing`](crate::grazing)): they depend on ray and mesh
//! alone, not on tree, layout, instruction set or company; they name points that are there; and no ray gets out
//! of a closed surface.

use crate::exact;
use crate::grazing::{Grazer, Kind, Shape, Surface, Volley, length, minus, weighted};
use crate::random::Random;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::intersect::{Limits, SceneScale};
use splitplane_core::query::traverse;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::Triangle;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// The core's reference traversal over a tree of one leaf: every ray that meets the bounds tests every triangle.
pub struct OneLeaf {
    /// The tree.
    pub tree: KdTree,
    triangles: Vec<Triangle>,
    scale: SceneScale,
}

impl OneLeaf {
    /// The tree of one leaf over a mesh.
    pub fn new(mesh: &Mesh<'_>) -> OneLeaf {
        let (tree, _, triangles) = exact::one_leaf(mesh, &BuildOptions::default());
        let kept = tree.references.iter().map(|&index| Limits::of(&triangles[index as usize]));
        let scale = SceneScale::new(tree.bounds, &kept.fold(Limits::NONE, Limits::union));
        OneLeaf { tree, triangles, scale }
    }

    /// The closest hits.
    pub fn closest(&self, rays: &[Ray], options: &QueryOptions<'_>) -> Vec<Hit> {
        let (view, triangles) = (self.tree.view(), &self.triangles[..]);
        let hit = |ray| traverse::closest_hit(&view, triangles, &self.scale, ray, options);
        rays.iter().map(|ray| hit(ray).unwrap_or(Hit::MISS)).collect()
    }

    /// Whether any hit of the reference says the same as its closest hit; gives the rays for which it does not.
    pub fn contradictions(&self, volley: &Volley, closest: &[Hit]) -> Vec<usize> {
        let (view, triangles) = (self.tree.view(), &self.triangles[..]);
        let any = |ray| traverse::any_hit(&view, triangles, &self.scale, ray, &volley.options);
        (0..closest.len()).filter(|&i| any(&volley.rays[i]) != closest[i].is_hit()).collect()
    }
}

/// A way to ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QueryMode {
    /// Closest hits, one ray a call.
    Singly,
    /// Closest hits of a batch in which neighbours stay together.
    Together,
    /// Closest hits of a batch in random order.
    Shuffled,
    /// Any hit, one ray a call.
    AnySingly,
    /// Any hit of a batch in which neighbours stay together.
    AnyTogether,
    /// Any hit of a batch in random order.
    AnyShuffled,
}

impl QueryMode {
    /// Closest hits.
    pub const CLOSEST: [QueryMode; 3] =
        [QueryMode::Singly, QueryMode::Together, QueryMode::Shuffled];
    /// Any hit.
    pub const ANY: [QueryMode; 3] =
        [QueryMode::AnySingly, QueryMode::AnyTogether, QueryMode::AnyShuffled];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            QueryMode::Singly => "singly",
            QueryMode::Together => "together",
            QueryMode::Shuffled => "shuffled",
            QueryMode::AnySingly => "any singly",
            QueryMode::AnyTogether => "any together",
            QueryMode::AnyShuffled => "any shuffled",
        }
    }

    fn is_any(self) -> bool {
        QueryMode::ANY.contains(&self)
    }
}

/// What an accelerator says of rays, asked in one way: hits, of which any hit has no more than whether there
/// are any.
pub fn ask(
    accelerator: &dyn Accelerator,
    rays: &[Ray],
    options: &QueryOptions<'_>,
    way: QueryMode,
    seed: u64,
) -> Vec<Hit> {
    let some = Hit { t: 0.0, triangle: 0, u: 0.0, v: 0.0 };
    let told = |is_hit: bool| if is_hit { some } else { Hit::MISS };
    // Results of an earlier batch: one that is left standing is found out.
    let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
    match way {
        QueryMode::Singly => {
            let hit = |ray| accelerator.closest_hit(ray, options).unwrap_or(Hit::MISS);
            rays.iter().map(hit).collect()
        }
        QueryMode::AnySingly => {
            rays.iter().map(|ray| told(accelerator.any_hit(ray, options))).collect()
        }
        QueryMode::Together => {
            let mut hits = vec![stale; rays.len()];
            accelerator.closest_hits(rays, &mut hits, options).expect("equal lengths");
            hits
        }
        QueryMode::AnyTogether => {
            let mut any: Vec<bool> = (0..rays.len()).map(|i| i % 2 == 0).collect();
            accelerator.any_hits(rays, &mut any, options).expect("equal lengths");
            any.into_iter().map(told).collect()
        }
        QueryMode::Shuffled | QueryMode::AnyShuffled => {
            let mut order: Vec<usize> = (0..rays.len()).collect();
            Random::new(seed).shuffle(&mut order);
            let batch: Vec<Ray> = order.iter().map(|&i| rays[i]).collect();
            let together = if way.is_any() { QueryMode::AnyTogether } else { QueryMode::Together };
            let hits = ask(accelerator, &batch, options, together, seed);
            let mut answers = vec![stale; rays.len()];
            order.into_iter().zip(hits).for_each(|(i, hit)| answers[i] = hit);
            answers
        }
    }
}

/// The rays whose answers, asked in one way, are not the expected ones: closest hits to the bit, any hit as to
/// whether there is one.
pub fn differences(answers: &[Hit], expected: &[Hit], way: QueryMode) -> Vec<usize> {
    let bits = |hit: &Hit| [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()];
    let differs = |i: &usize| match way.is_any() {
        true => answers[*i].is_hit() != expected[*i].is_hit(),
        false => bits(&answers[*i]) != bits(&expected[*i]),
    };
    (0..expected.len()).filter(differs).collect()
}

/// The rays that got out of a closed surface.
pub fn lost(volley: &Volley, hits: &[Hit]) -> Vec<usize> {
    (0..hits.len()).filter(|&i| volley.is_held() && !hits[i].is_hit()).collect()
}

/// What is wrong with a hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsound {
    /// Its `t` is not finite.
    NotFinite,
    /// Its `t` lies outside the ray's limits.
    OutsideLimits,
    /// A weight is negative, or their sum is more than 1 and a few ulps.
    Weights,
    /// The point at its `t` and the point of its weights lie too far apart.
    Apart,
    /// The point at its `t` lies outside the bounds of its triangle.
    OutsideBounds,
}

impl Unsound {
    /// In words.
    pub const fn what(self) -> &'static str {
        match self {
            Unsound::NotFinite => "t is not finite",
            Unsound::OutsideLimits => "t is outside the limits",
            Unsound::Weights => "weights are out of range",
            Unsound::Apart => "t and weights disagree",
            Unsound::OutsideBounds => "t is outside the triangle",
        }
    }
}

/// How far apart the point at `t` and the point of the weights may lie, in units of 2^-24 times the distance of
/// the farthest corner from the origin and the triangle's longest extent together. What is derived is wider:
/// interpolated weights may place the point 12 * 256 units of the sheared coordinates off (`SLIVER` in core), `t` by 512
/// of its own. This is what was seen, 101 units at most of a thousand million rays, with room.
pub const APART: f64 = 500.0;
/// The relative error of one rounding.
const ULP: f64 = 1.0 / 16_777_216.0;
/// By how much the weights' sum may exceed 1.
const WEIGHTS_OVER: f64 = 8.0 * ULP;

/// Origin coordinates below 2^-60 are taken for one value, 0 or 2^-60, so they move by up to 2^-59 on each axis: points
/// may lie so much farther apart.
pub const MOVED: f64 = 1.0 / (1u64 << 58) as f64;

/// How far the point at a hit's `t` and the point of its weights lie apart, less [`MOVED`], in the unit of [`APART`].
pub fn apart(triangle: &Triangle, ray: &Ray, hit: &Hit) -> f64 {
    let (u, v) = (f64::from(hit.u), f64::from(hit.v));
    let of_weights = weighted(&triangle.map(|p| p.map(f64::from)), [1.0 - u - v, u, v]);
    let apart = length(minus(point_at(ray, hit.t), of_weights)) - MOVED;
    apart.max(0.0) / unit(triangle, ray)
}

/// One unit of [`APART`].
fn unit(triangle: &Triangle, ray: &Ray) -> f64 {
    let (bounds, origin) = (Aabb::of_points(triangle), ray.origin.map(f64::from));
    let extent = |k: usize| f64::from(bounds.hi[k]) - f64::from(bounds.lo[k]);
    let size = (0..3).map(extent).fold(0.0, f64::max);
    let distance = |corner: &[f32; 3]| length(minus(corner.map(f64::from), origin));
    ULP * (triangle.iter().map(distance).fold(0.0, f64::max) + size)
}

fn point_at(ray: &Ray, t: f32) -> [f64; 3] {
    [0, 1, 2].map(|k| f64::from(ray.origin[k]) + f64::from(t) * f64::from(ray.direction[k]))
}

/// Holds a hit against its triangle and its ray.
///
/// # Errors
/// What is wrong.
pub fn soundness(triangle: &Triangle, ray: &Ray, hit: &Hit) -> Result<(), Unsound> {
    if !hit.t.is_finite() {
        return Err(Unsound::NotFinite);
    }
    if !(ray.t_min <= hit.t && hit.t <= ray.t_max) {
        return Err(Unsound::OutsideLimits);
    }
    let (u, v) = (f64::from(hit.u), f64::from(hit.v));
    if !(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + WEIGHTS_OVER) {
        return Err(Unsound::Weights);
    }
    let (bounds, point) = (Aabb::of_points(triangle), point_at(ray, hit.t));
    let slack = APART * unit(triangle, ray) + MOVED;
    let within = |k: usize| {
        f64::from(bounds.lo[k]) - slack <= point[k] && point[k] <= f64::from(bounds.hi[k]) + slack
    };
    if !(0..3).all(within) {
        return Err(Unsound::OutsideBounds);
    }
    if apart(triangle, ray, hit) > APART {
        return Err(Unsound::Apart);
    }
    Ok(())
}

/// A ray for which something is not as demanded.
#[derive(Clone, Debug)]
pub struct Failure {
    /// What is not.
    pub what: &'static str,
    /// The surface, by shape and seed.
    pub surface: (Shape, u64),
    /// The ray.
    pub ray: Ray,
    /// What was asked besides.
    pub options: QueryOptions<'static>,
    /// Which backend was asked what, and its answer.
    pub text: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (shape, seed) = self.surface;
        let QueryOptions { culling, ignore, .. } = self.options;
        write!(f, "{}: {} {seed}, ray", self.what, shape.name())?;
        words(&self.ray).iter().try_for_each(|word| write!(f, " {word:08x}"))?;
        write!(f, ", culling {culling:?}, ignore {ignore:?}: {}", self.text)
    }
}

/// A ray's words, in the order of ray files.
pub fn words(ray: &Ray) -> [u32; 8] {
    let ([a, b, c], [d, e, f]) = (ray.origin, ray.direction);
    [a, b, c, d, e, f, ray.t_min, ray.t_max].map(f32::to_bits)
}

/// The ray of these words.
pub fn ray_of(words: [u32; 8]) -> Ray {
    let [a, b, c, d, e, f, t_min, t_max] = words.map(f32::from_bits);
    Ray::new([a, b, c], [d, e, f]).with_limits(t_min, t_max)
}

/// What was counted.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Surfaces.
    pub surfaces: u64,
    /// Rays.
    pub rays: u64,
    /// Rays that hit, by the expected answers.
    pub hits: u64,
    /// Answers that were held against the expected ones.
    pub answers: u64,
    /// Rays of which a closest hit was not the expected one.
    pub different: u64,
    /// Rays of which any hit was not as expected.
    pub disagreeing: u64,
    /// Rays from inside closed surfaces.
    pub inside: u64,
    /// Those that hit nothing, by the expected answers or any other closest hit.
    pub lost: u64,
    /// Expected hits that are not sound.
    pub unsound: u64,
    /// The farthest apart that the points of `t` and weights of a hit lay, in the unit of [`APART`].
    pub worst: f64,
    /// Where failures occurred, and how often: by what, shape, kind, and who answered.
    pub failures: BTreeMap<String, u64>,
    /// The first of each sort.
    pub first: Vec<Failure>,
}

impl Tally {
    /// Adds what another one counted.
    pub fn add(&mut self, other: Tally) {
        self.surfaces += other.surfaces;
        self.rays += other.rays;
        self.hits += other.hits;
        self.answers += other.answers;
        self.different += other.different;
        self.disagreeing += other.disagreeing;
        self.inside += other.inside;
        self.lost += other.lost;
        self.unsound += other.unsound;
        self.worst = self.worst.max(other.worst);
        for (place, count) in other.failures {
            *self.failures.entry(place).or_default() += count;
        }
        for failure in other.first {
            if self.first.iter().all(|known| known.what != failure.what) {
                self.first.push(failure);
            }
        }
    }

    /// Closest hits depend on ray and mesh alone.
    ///
    /// # Errors
    /// All that was counted, and the first failure of each sort, as for the checks below.
    pub fn closest_hits_agree(&self) -> Result<(), String> {
        self.demand(self.different == 0)
    }

    /// There is any hit where there is a closest one.
    ///
    /// # Errors
    /// There was, where there was none, or the other way round.
    pub fn any_hits_agree(&self) -> Result<(), String> {
        self.demand(self.disagreeing == 0)
    }

    /// No ray got out of a closed surface.
    ///
    /// # Errors
    /// One did.
    pub fn none_is_lost(&self) -> Result<(), String> {
        self.demand(self.lost == 0)
    }

    /// Hits are finite, within limits, and name one point of the triangle twice.
    ///
    /// # Errors
    /// One does not.
    pub fn hits_are_sound(&self) -> Result<(), String> {
        self.demand(self.unsound == 0)
    }

    /// All of these.
    ///
    /// # Errors
    /// One fails.
    pub fn all_is_well(&self) -> Result<(), String> {
        self.closest_hits_agree()?;
        self.any_hits_agree()?;
        self.none_is_lost()?;
        self.hits_are_sound()
    }

    fn demand(&self, kept: bool) -> Result<(), String> {
        if kept { Ok(()) } else { Err(self.to_string()) }
    }

    /// Counts one failure, for the ray of a volley, by what, shape, kind, and by labels.
    fn fail(
        &mut self,
        (surface, volley, i): (&Surface, &Volley, usize),
        what: &'static str,
        labels: &[&str],
        text: String,
    ) {
        for label in [surface.shape.name(), volley.kind.name()].iter().chain(labels) {
            *self.failures.entry(format!("{what}, {label}")).or_default() += 1;
        }
        if self.first.iter().all(|known| known.what != what) {
            let (ray, options) = (volley.rays[i], volley.options);
            let surface = (surface.shape, surface.seed);
            self.first.push(Failure { what, surface, ray, options, text });
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Tally { surfaces, rays, hits, answers, different, disagreeing, .. } = self;
        let Tally { inside, lost, unsound, worst, .. } = self;
        writeln!(f, "{surfaces} surfaces, {rays} rays, {hits} hits, {answers} answers compared")?;
        writeln!(f, "rays with another closest hit: {different}")?;
        writeln!(f, "rays with another any hit: {disagreeing}")?;
        writeln!(f, "rays lost from inside: {lost} of {inside}")?;
        writeln!(f, "hits that are not sound: {unsound}")?;
        writeln!(f, "points of t and weights apart at most: {worst:.1} units, of {APART} allowed")?;
        for (place, count) in &self.failures {
            writeln!(f, "  {place}: {count}")?;
        }
        self.first.iter().try_for_each(|failure| writeln!(f, "first {failure}"))
    }
}

/// Which backend is asked, and how.
pub struct Asked<'a> {
    /// The name: preset, layout, instruction set.
    pub name: &'a [String],
    /// Which backend is asked.
    pub accelerator: &'a dyn Accelerator,
    /// In which ways.
    pub ways: &'a [QueryMode],
}

/// Holds the expected answers to a volley against the surface, and all others against them.
pub fn examine(
    surface: &Surface,
    triangles: &[Triangle],
    volley: &Volley,
    expected: &[Hit],
    asked: &[Asked<'_>],
) -> Tally {
    let mut tally = judge(surface, triangles, volley, expected);
    tally.add(compare(surface, volley, expected, asked));
    tally
}

/// Holds answers to a volley against the surface.
pub fn judge(surface: &Surface, triangles: &[Triangle], volley: &Volley, hits: &[Hit]) -> Tally {
    let mut tally = Tally { rays: volley.rays.len() as u64, ..Tally::default() };
    for (i, (ray, hit)) in volley.rays.iter().zip(hits).enumerate() {
        if !hit.is_hit() {
            continue;
        }
        tally.hits += 1;
        let triangle = &triangles[hit.triangle as usize];
        tally.worst = tally.worst.max(apart(triangle, ray, hit));
        if let Err(unsound) = soundness(triangle, ray, hit) {
            tally.unsound += 1;
            let text = format!("{hit:?}, {:.1} units apart", apart(triangle, ray, hit));
            tally.fail((surface, volley, i), unsound.what(), &[], text);
        }
    }
    if volley.is_held() {
        tally.inside += volley.rays.len() as u64;
    }
    for i in lost(volley, hits) {
        tally.lost += 1;
        tally.fail((surface, volley, i), "lost from inside", &[], "the expected answer".into());
    }
    tally
}

/// Holds all answers to a volley against the expected ones.
pub fn compare(surface: &Surface, volley: &Volley, expected: &[Hit], asked: &[Asked<'_>]) -> Tally {
    let mut tally = Tally::default();
    let [mut different, mut disagreeing, mut all_lost] = [(); 3].map(|()| BTreeSet::new());
    for (number, Asked { name, accelerator, ways }) in asked.iter().enumerate() {
        for &way in *ways {
            let seed = surface.seed.wrapping_add(number as u64);
            let answers = ask(*accelerator, &volley.rays, &volley.options, way, seed);
            tally.answers += answers.len() as u64;
            if !way.is_any() {
                let lost = lost(volley, &answers);
                all_lost.extend(lost.into_iter().filter(|&i| expected[i].is_hit()));
            }
            for i in differences(&answers, expected, way) {
                let (what, set) = match way.is_any() {
                    true => ("any hit differs", &mut disagreeing),
                    false => ("closest hit differs", &mut different),
                };
                set.insert(i);
                let (found, wanted) = (answers[i], expected[i]);
                let (who, how) = (name.join(", "), way.name());
                let text = format!("{who}, {how}: found {found:?}, expected {wanted:?}");
                let mut labels: Vec<&str> = name.iter().map(String::as_str).collect();
                labels.push(how);
                tally.fail((surface, volley, i), what, &labels, text);
            }
        }
    }
    for &i in &all_lost {
        let text = format!("expected {:?}", expected[i]);
        tally.fail((surface, volley, i), "lost from inside", &[], text);
    }
    tally.different = different.len() as u64;
    tally.disagreeing = disagreeing.len() as u64;
    tally.lost = all_lost.len() as u64;
    tally
}

/// The seed of the `number`-th surface of a run.
pub fn seed_of(run: u64, number: u64) -> u64 {
    (run.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number.wrapping_mul(0xd1b5_4a32_d192_ed03)) >> 16
}

/// The volleys at a surface: `each` rays of every kind, and [`INSIDE`] times as many from inside.
pub fn volleys(surface: &Surface, each: usize) -> Vec<Volley> {
    let mut grazer = Grazer::new(surface, surface.seed ^ 0x5eed);
    let kinds: Vec<Kind> = grazer.kinds().collect();
    let count = |kind: Kind| if kind == Kind::Inside { INSIDE * each } else { each };
    kinds.into_iter().map(|kind| grazer.volley(kind, count(kind))).collect()
}

/// How many times as many rays come from inside: those that are lost are rare.
pub const INSIDE: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: Triangle = [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]];

    /// Each thing that may be wrong with a hit is found.
    #[test]
    fn what_is_wrong_with_a_hit_is_named() {
        let ray = Ray::new([0.25, 0.5, 0.0], [0.0, 0.0, 1.0]).with_limits(0.0, 9.0);
        let good = Hit { t: 2.0, triangle: 0, u: 0.25, v: 0.5 };
        let held = |hit| soundness(&TRIANGLE, &ray, &hit);
        assert_eq!(held(good), Ok(()));
        assert_eq!(held(Hit { t: f32::INFINITY, ..good }), Err(Unsound::NotFinite));
        assert_eq!(held(Hit { t: f32::NAN, ..good }), Err(Unsound::NotFinite));
        assert_eq!(held(Hit { t: 9.5, ..good }), Err(Unsound::OutsideLimits));
        assert_eq!(held(Hit { t: -1.0, ..good }), Err(Unsound::OutsideLimits));
        assert_eq!(held(Hit { u: -1e-7, ..good }), Err(Unsound::Weights));
        assert_eq!(held(Hit { v: -1e-7, ..good }), Err(Unsound::Weights));
        assert_eq!(held(Hit { u: 0.500_001, ..good }), Err(Unsound::Weights));
        assert_eq!(held(Hit { u: f32::NAN, ..good }), Err(Unsound::Weights));
        assert_eq!(held(Hit { t: 2.1, ..good }), Err(Unsound::OutsideBounds));
        assert_eq!(held(Hit { u: 0.25001, v: 0.5, ..good }), Ok(()));
        assert_eq!(held(Hit { u: 0.2501, ..good }), Err(Unsound::Apart));
        assert_eq!(held(Hit { u: 0.5, v: 0.25, ..good }), Err(Unsound::Apart));
    }

    #[test]
    fn rays_survive_as_words() {
        let ray = Ray::new([1.0, -2.0, 3e-7], [0.5, -0.0, 1e9]).with_limits(-1.0, f32::INFINITY);
        assert_eq!(words(&ray_of(words(&ray))), words(&ray));
    }
}
