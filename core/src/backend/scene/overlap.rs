//! The triangles of a scene that meet a box, a ball, a capsule, a convex set or a triangle.
//!
//! In the world a triangle has its corners under the instance's transform, computed in `f64` as for closest points and rounded to `f32`, then
//! snapped. What meets it is decided exactly ([`query::overlap`](crate::query::overlap)). So an instance in place has the answers of its mesh, and
//! neither trees nor backends change an answer. A triangle with a corner that does not fit an `f32` does not count.
//!
//! A cell of a geometry's tree is passed over by the box in the world around it, rounded outwards, which is widened by what rounding the
//! corners may move them.

use alloc::vec::Vec;

use super::built::BuiltScene;
use super::closest_point::in_other_space;
use crate::arithmetic::snap;
use crate::cancel::go_on_tracing;
use crate::error::{QueryError, check_bytes, refused};
use crate::query::overlap::{Patience, Region, Volume, visit_cells};
use crate::query::traverse::Triangles;
use crate::scene::{IgnoredTriangle, InstanceId, Placement, transformed};
use crate::triangle::Triangle;
use crate::watch::Watch;

/// A triangle of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SceneTriangle {
    /// The instance ([`InstanceId`]).
    pub instance: u32,
    /// Index of the triangle in the geometry's mesh.
    pub triangle: u32,
}

/// Settings of a query for overlaps with a scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneOverlapOptions<'a> {
    /// Instances answer when a bit of theirs is in this mask.
    pub mask: u32,
    /// A triangle of one instance to ignore.
    pub ignore: Option<IgnoredTriangle>,
    /// Most bytes that the answer and its parts may take; `None` for no limit.
    pub max_memory: Option<u64>,
    /// Receives the number of volumes that are done, and may cancel the batch; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

impl Default for SceneOverlapOptions<'_> {
    fn default() -> Self {
        SceneOverlapOptions { mask: u32::MAX, ignore: None, max_memory: None, watch: None }
    }
}

/// The triangles that each volume of a batch meets.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOverlaps {
    /// Where the triangles of each volume begin, followed by the number of all: one entry more than there are volumes.
    pub starts: Vec<usize>,
    /// The triangles of all volumes, volume by volume, in ascending order of (instance, triangle).
    pub triangles: Vec<SceneTriangle>,
}

impl Default for SceneOverlaps {
    fn default() -> SceneOverlaps {
        SceneOverlaps { starts: Vec::from([0]), triangles: Vec::new() }
    }
}

impl SceneOverlaps {
    /// The triangles that a volume of the batch meets, in ascending order.
    pub fn of(&self, volume: usize) -> &[SceneTriangle] {
        &self.triangles[self.starts[volume]..self.starts[volume + 1]]
    }

    /// Bytes that both lists hold, spare capacity included.
    pub fn bytes(&self) -> u64 {
        let starts = self.starts.capacity() * size_of::<usize>();
        (starts + self.triangles.capacity() * size_of::<SceneTriangle>()) as u64
    }

    /// Appends the answers to more volumes.
    ///
    /// # Errors
    /// More memory than `max_memory` allows, or than the system has.
    pub fn append(
        &mut self,
        more: SceneOverlaps,
        max_memory: Option<u64>,
    ) -> Result<(), QueryError> {
        let needed = self.bytes() + more.bytes();
        check_bytes(needed, max_memory)?;
        self.starts.try_reserve(more.starts.len()).map_err(|_| refused(needed))?;
        self.triangles.try_reserve(more.triangles.len()).map_err(|_| refused(needed))?;
        let first = self.triangles.len();
        self.starts.extend(more.starts.iter().skip(1).map(|start| first + start));
        self.triangles.extend(more.triangles);
        Ok(())
    }
}

/// What rounding to `f32` moves a coordinate by, and what snapping does, at most.
fn widened([mut lo, mut hi]: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
    const ROUNDED: f64 = f32::EPSILON as f64;
    const SNAPPED: f64 = 2.0 * f32::MIN_POSITIVE as f64;
    for axis in 0..3 {
        lo[axis] -= lo[axis].abs() * ROUNDED + SNAPPED;
        hi[axis] += hi[axis].abs() * ROUNDED + SNAPPED;
    }
    [lo, hi]
}

impl BuiltScene {
    /// The triangles that each volume meets in the world, exactly: one volume after the other, on the calling thread.
    /// [`SceneAccelerator::overlaps`](super::SceneAccelerator::overlaps) takes all threads where the backend has some.
    ///
    /// # Errors
    /// More memory than the options allow or than the system has, a watch that cancels the batch, and
    /// [`QueryError::Unsupported`] where an instance that answers is one of shapes.
    pub fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        let total = volumes.len() as u64;
        let mut all = SceneOverlaps::default();
        let mut found: Vec<SceneTriangle> = Vec::new();
        for (done, volume) in volumes.iter().enumerate() {
            go_on_tracing(options.watch, done as u64, total)?;
            found.clear();
            let held = (all.starts.len() * size_of::<usize>()
                + all.triangles.len() * size_of::<SceneTriangle>()) as u64;
            self.visit_overlaps(volume, options, [done as u64, total], |own| {
                if found.len() == found.capacity() {
                    found.sort_unstable();
                    found.dedup();
                    let more = (found.len() / 2).max(16);
                    if found.capacity() - found.len() < more {
                        let bytes = (found.len() + more) * size_of::<SceneTriangle>();
                        let needed = held + 2 * bytes as u64;
                        check_bytes(needed, options.max_memory)?;
                        found.try_reserve_exact(more).map_err(|_| refused(needed))?;
                    }
                }
                found.push(own);
                Ok(true)
            })?;
            found.sort_unstable();
            found.dedup();
            let needed = held + (2 * found.len() * size_of::<SceneTriangle>()) as u64;
            check_bytes(needed, options.max_memory)?;
            all.triangles.try_reserve(found.len()).map_err(|_| refused(needed))?;
            all.starts.try_reserve(1).map_err(|_| refused(needed))?;
            all.triangles.extend_from_slice(&found);
            all.starts.push(all.triangles.len());
        }
        go_on_tracing(options.watch, total, total)?;
        Ok(all)
    }

    /// Whether a volume meets any triangle in the world, exactly. The watch is called only while a volume of many planes is looked
    /// at.
    ///
    /// # Errors
    /// As for [`BuiltScene::overlaps`].
    pub fn overlaps_any(
        &self,
        volume: &Volume<'_>,
        options: &SceneOverlapOptions<'_>,
    ) -> Result<bool, QueryError> {
        let mut any = false;
        self.visit_overlaps(volume, options, [0, 1], |_| {
            any = true;
            Ok(false)
        })?;
        Ok(any)
    }

    /// Gives `visit` what a volume meets, some of it more than once, until it returns false.
    fn visit_overlaps(
        &self,
        volume: &Volume<'_>,
        options: &SceneOverlapOptions<'_>,
        volumes: [u64; 2],
        mut visit: impl FnMut(SceneTriangle) -> Result<bool, QueryError>,
    ) -> Result<(), QueryError> {
        let shaped = |(_, placement): (InstanceId, &Placement)| {
            let geometry = self.geometry(placement.instance.geometry);
            placement.answers(options.mask)
                && geometry.is_some_and(|geometry| geometry.shapes().is_some())
        };
        if self.geometries().any(|(_, geometry)| geometry.shapes().is_some())
            && self.placements().any(shaped)
        {
            return Err(QueryError::Unsupported { query: "overlaps of shapes" });
        }
        let Some(region) = Region::new(volume)? else { return Ok(()) };
        let mut go_on = true;
        let patience = Patience::new(options.watch, volumes);
        self.top.meeting(
            |ends| region.may_meet_box(widened(ends)),
            |name| {
                let instance = InstanceId(name);
                let Some(placement) =
                    self.placement(instance).filter(|own| own.answers(options.mask))
                else {
                    return Ok(true);
                };
                let Some(geometry) = self.geometry(placement.instance.geometry) else {
                    return Ok(true);
                };
                let ignored = options.ignore.filter(|ignored| ignored.instance == instance);
                let transform = &placement.instance.transform;
                let mesh = geometry.mesh().mesh();
                visit_cells(
                    &geometry.accelerator().tree().view(),
                    |cell| {
                        patience.record(region.work());
                        region.may_meet_box(widened(transformed(transform, cell)))
                    },
                    |leaf| {
                        for &triangle in leaf {
                            patience.record(region.work());
                            patience.check()?;
                            if ignored.is_some_and(|ignored| ignored.triangle == triangle) {
                                continue;
                            }
                            let corners: Triangle = mesh.corners(triangle).map(|corner| {
                                in_other_space(transform, corner.map(f64::from))
                                    .map(|x| snap(x as f32))
                            });
                            let fits = corners.as_flattened().iter().all(|x| x.is_finite());
                            if fits && region.meets(&corners) {
                                go_on = visit(SceneTriangle { instance: name, triangle })?;
                                if !go_on {
                                    return Ok(false);
                                }
                            }
                        }
                        Ok(true)
                    },
                )?;
                Ok(go_on)
            },
        )
    }
}
