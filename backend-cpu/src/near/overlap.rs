//! Overlaps, through the wide nodes of rays. What meets is decided as the reference does ([`splitplane_core::query::overlap`]), so
//! the answers are its, bit for bit.

use splitplane_core::aabb::Aabb;
use splitplane_core::error::QueryError;
use splitplane_core::query::overlap::{OverlapOptions, Region, add};
use splitplane_core::triangle::Triangle;

use super::cells::CellVisitor;
use crate::cancel::ProgressMeter;

/// Looks for the triangles that a volume meets.
pub(crate) struct Overlapping<'a> {
    pub region: Region,
    /// Whether one triangle is enough.
    pub any: bool,
    pub options: &'a OverlapOptions<'a>,
    /// Receives the progress within a volume, which may have many planes.
    pub meter: &'a ProgressMeter<'a>,
    /// In any order, some more than once.
    pub found: Vec<u32>,
}

impl CellVisitor for Overlapping<'_> {
    fn bound(&self, cell: &Aabb) -> Option<f64> {
        // A few planes take as long as a reference; other volumes count as nothing here.
        self.meter.record_work(self.region.work() / 4);
        self.region.may_meet(cell).then_some(0.0)
    }

    fn is_open(&self, _: f64) -> bool {
        !self.meter.is_cancelled()
    }

    fn test(&mut self, corners: &Triangle, triangle: u32) -> Result<bool, QueryError> {
        if self.meter.record_work(self.region.work() / 4) {
            return Ok(false);
        }
        if self.options.ignore == Some(triangle) || !self.region.meets(corners) {
            return Ok(true);
        }
        add(&mut self.found, triangle, self.options.max_memory)?;
        Ok(!self.any)
    }
}
