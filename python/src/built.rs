//! What answers for a scene: all of it built at once, or each geometry when rays reach it.

use splitplane::objects::{
    LazyError, LazyScene, SceneAccelerator, SceneAllHits, SceneAllHitsOptions, SceneClosestPoint,
    SceneClosestPointOptions, SceneHit, SceneOptions, SceneOverlapOptions, SceneOverlaps,
    SceneReport, write_file,
};
use splitplane::{LocateOptions, Located, QueryReport, Ray, Volume, Watch};

use crate::failure::Failure;

/// A scene that is built. Both kinds give the same answers.
pub(crate) enum Built {
    /// All at once.
    Whole(Box<dyn SceneAccelerator>),
    /// As rays reach it, under a limit of bytes.
    Lazy(Box<LazyScene>, Option<u64>),
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
            other => Failure::new("QueryError", other.to_string()),
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
                    Built::Lazy(scene, _) => Ok(scene.$name($($argument),*)?),
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
            Built::Lazy(scene, _) => scene.waiting(),
        }
    }

    /// Bytes that are held for queries.
    pub(crate) fn bytes(&self) -> u64 {
        match self {
            Built::Whole(scene) => scene.scene().bytes(),
            Built::Lazy(scene, _) => scene.bytes(),
        }
    }

    /// Builds all that waits.
    pub(crate) fn complete(&self, watch: &dyn Watch) -> Result<(), Failure> {
        match self {
            Built::Whole(_) => Ok(()),
            Built::Lazy(scene, _) => Ok(scene.complete(Some(watch))?),
        }
    }

    /// The digest of all, which is built first.
    pub(crate) fn digest(&self, watch: &dyn Watch) -> Result<String, Failure> {
        self.complete(watch)?;
        Ok(match self {
            Built::Whole(scene) => scene.scene().digest().to_string(),
            Built::Lazy(scene, _) => scene.look(|built| built.digest().to_string()),
        })
    }

    /// The bytes of a scene file, for which all is built.
    pub(crate) fn to_bytes(&self, watch: &dyn Watch) -> Result<Vec<u8>, Failure> {
        match self {
            Built::Whole(scene) => Ok(write_file(scene.scene())?),
            Built::Lazy(scene, _) => Ok(scene.save(Some(watch))?),
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
