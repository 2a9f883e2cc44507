//! What answers for a scene: all of it built at once, or each geometry when rays reach it.

use library::core::tree::digest::Digest;
use library::objects::{
    LazyError, LazyScene, SceneAccelerator, SceneAllHits, SceneAllHitsOptions, SceneClosestPoint,
    SceneClosestPointOptions, SceneHit, SceneOptions, SceneOverlapOptions, SceneOverlaps,
    SceneReport, write_file,
};
use library::{LocateOptions, Located, QueryReport, Ray, Volume, Watch};

use crate::status::{Failure, Status};

/// A scene that is built. Both kinds give the same answers.
pub(crate) enum Built {
    /// All at once.
    Whole(Box<dyn SceneAccelerator>),
    /// As rays reach it.
    Lazy(Box<LazyScene>),
}

impl From<LazyError> for Failure {
    fn from(error: LazyError) -> Failure {
        match error {
            LazyError::Build(error) => {
                let own = Failure::from(error);
                Failure { text: format!("not built when it was needed: {}", own.text), ..own }
            }
            LazyError::Query(error) => error.into(),
            LazyError::Write(error) => error.into(),
            other => Failure::new(Status::Unsupported, other.to_string()),
        }
    }
}

/// Calls that both kinds have by one name.
macro_rules! both {
    ($($name:ident($($argument:ident: $kind:ty),*) -> $answer:ty;)*) => {
        $(
            pub(crate) fn $name(&self, $($argument: $kind),*) -> Result<$answer, Failure> {
                match self {
                    Built::Whole(scene) => Ok(scene.$name($($argument),*)?),
                    Built::Lazy(scene) => Ok(scene.$name($($argument),*)?),
                }
            }
        )*
    };
}

impl Built {
    /// Geometries that wait for rays.
    pub(crate) fn waiting(&self) -> usize {
        match self {
            Built::Whole(_) => 0,
            Built::Lazy(scene) => scene.waiting(),
        }
    }

    /// Builds all that waits.
    pub(crate) fn complete(&self, watch: Option<&dyn Watch>) -> Result<(), Failure> {
        match self {
            Built::Whole(_) => Ok(()),
            Built::Lazy(scene) => Ok(scene.complete(watch)?),
        }
    }

    /// The digest of all, which is built first.
    pub(crate) fn digest(&self) -> Result<Digest, Failure> {
        self.complete(None)?;
        Ok(match self {
            Built::Whole(scene) => scene.scene().digest(),
            Built::Lazy(scene) => scene.look(|built| built.digest()),
        })
    }

    /// The bytes of a scene file, for which all is built.
    pub(crate) fn to_bytes(&self) -> Result<Vec<u8>, Failure> {
        match self {
            Built::Whole(scene) => Ok(write_file(scene.scene())?),
            Built::Lazy(scene) => Ok(scene.save(None)?),
        }
    }

    both! {
        closest_hits(rays: &[Ray], hits: &mut [SceneHit], options: &SceneOptions<'_>) -> SceneReport;
        any_hits(rays: &[Ray], occluded: &mut [bool], options: &SceneOptions<'_>) -> SceneReport;
        all_hits(rays: &[Ray], options: &SceneAllHitsOptions<'_>) -> SceneAllHits;
        count_hits(rays: &[Ray], counts: &mut [u64], options: &SceneAllHitsOptions<'_>) -> QueryReport;
        locate(points: &[[f32; 3]], options: &LocateOptions<'_>) -> Located;
        closest_points(points: &[[f32; 3]], closest: &mut [SceneClosestPoint], options: &SceneClosestPointOptions<'_>) -> QueryReport;
        overlaps(volumes: &[Volume<'_>], options: &SceneOverlapOptions<'_>) -> SceneOverlaps;
        overlaps_any(volumes: &[Volume<'_>], found: &mut [bool], options: &SceneOverlapOptions<'_>) -> ();
    }
}
