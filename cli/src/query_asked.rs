//! What `splitplane query` asks, and what comes back: of one mesh or of a scene of many objects.

use super::failure::Failure;
use super::query_given::{Arguments, Given, Kind, answers};
use splitplane::objects::{SceneAllHits, SceneClosestPoint, SceneHit};
use splitplane::{AllHits, ClosestPoint, Hit, Located, Location, Ray, Rule};

/// The answers of one mesh or of a scene.
pub(super) trait Answers {
    /// A closest hit.
    type Hit: Copy;
    /// What a ray has that hits nothing.
    const MISS: Self::Hit;
    /// All hits of all rays.
    type AllHits;
    /// A closest point.
    type ClosestPoint: Copy;
    /// What a point has that nothing is near to.
    const NO_POINT: Self::ClosestPoint;

    fn is_hit(hit: &Self::Hit) -> bool;
    fn crossings(all: &Self::AllHits) -> usize;
    fn is_some(closest: &Self::ClosestPoint) -> bool;
}

/// Of one mesh.
pub(super) enum OfMesh {}

impl Answers for OfMesh {
    type Hit = Hit;
    const MISS: Hit = Hit::MISS;
    type AllHits = AllHits;
    type ClosestPoint = ClosestPoint;
    const NO_POINT: ClosestPoint = ClosestPoint::NONE;

    fn is_hit(hit: &Hit) -> bool {
        hit.is_hit()
    }
    fn crossings(all: &AllHits) -> usize {
        all.crossings.len()
    }
    fn is_some(closest: &ClosestPoint) -> bool {
        closest.is_some()
    }
}

/// Of a scene of many objects.
pub(super) enum OfScene {}

impl Answers for OfScene {
    type Hit = SceneHit;
    const MISS: SceneHit = SceneHit::MISS;
    type AllHits = SceneAllHits;
    type ClosestPoint = SceneClosestPoint;
    const NO_POINT: SceneClosestPoint = SceneClosestPoint::NONE;

    fn is_hit(hit: &SceneHit) -> bool {
        hit.is_hit()
    }
    fn crossings(all: &SceneAllHits) -> usize {
        all.crossings.len()
    }
    fn is_some(closest: &SceneClosestPoint) -> bool {
        closest.is_some()
    }
}

/// What is asked, and what came back.
pub(super) enum Asked<A: Answers> {
    Closest(Vec<Ray>, Vec<A::Hit>),
    Any(Vec<Ray>, Vec<bool>),
    /// Nothing before the rays are traced.
    All(Vec<Ray>, Option<A::AllHits>),
    Inside(Vec<[f32; 3]>, Located),
    /// Where signs are asked for, with where the points lie.
    ClosestPoint {
        points: Vec<[f32; 3]>,
        closest: Vec<A::ClosestPoint>,
        signs: Option<Located>,
        within: f32,
    },
}

impl<A: Answers> Asked<A> {
    /// Reads rays or points, and makes room for the answers.
    pub(super) fn read(arguments: &Arguments) -> Result<Asked<A>, Failure> {
        Ok(match Given::read(arguments)? {
            Given::Points(points) if arguments.kind == Kind::Inside => {
                Asked::Inside(points, Located::default())
            }
            Given::Points(points) => {
                let closest = answers(points.len(), A::NO_POINT)?;
                let signs = arguments.signed.then(Located::default);
                let within = arguments.max_distance();
                Asked::ClosestPoint { points, closest, signs, within }
            }
            Given::Rays(rays) => {
                let count = rays.len();
                match arguments.kind {
                    Kind::Closest => Asked::Closest(rays, answers(count, A::MISS)?),
                    Kind::Any => Asked::Any(rays, answers(count, false)?),
                    Kind::All | Kind::Inside | Kind::ClosestPoint => Asked::All(rays, None),
                }
            }
        })
    }

    /// Rays or points.
    pub(super) fn count(&self) -> usize {
        match self {
            Asked::Closest(rays, _) | Asked::Any(rays, _) | Asked::All(rays, _) => rays.len(),
            Asked::Inside(points, _) | Asked::ClosestPoint { points, .. } => points.len(),
        }
    }

    /// Rays that hit, crossings, points inside, or points that have a closest one.
    pub(super) fn found(&self) -> usize {
        match self {
            Asked::Closest(_, hits) => hits.iter().filter(|hit| A::is_hit(hit)).count(),
            Asked::Any(_, hits) => hits.iter().filter(|hit| **hit).count(),
            Asked::All(_, all) => all.as_ref().map_or(0, A::crossings),
            Asked::Inside(_, located) => {
                let inside =
                    |&point: &usize| located.location(point, Rule::NonZero) == Location::Inside;
                (0..located.windings.len()).filter(inside).count()
            }
            Asked::ClosestPoint { closest, .. } => {
                closest.iter().filter(|closest| A::is_some(closest)).count()
            }
        }
    }
}

/// The accuracy of answers, by name.
pub(super) fn accuracy_name(arguments: &Arguments) -> &'static str {
    match arguments.kind {
        Kind::ClosestPoint => arguments.common.nearness_name(),
        Kind::All | Kind::Inside => "exact",
        Kind::Closest | Kind::Any => arguments.common.accuracy_name(),
    }
}
