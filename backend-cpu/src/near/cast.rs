//! Impacts, through the wide nodes of rays: triangles are tested as the reference does ([`splitplane_core::query::cast`]), so the answers
//! are its, bit for bit.

use splitplane_core::aabb::Aabb;
use splitplane_core::error::QueryError;
use splitplane_core::query::cast::CastSearch;
use splitplane_core::triangle::Triangle;

use super::cells::CellVisitor;

/// Looks for the first impact.
pub(crate) struct Impacts(pub(crate) CastSearch);

impl CellVisitor for Impacts {
    fn bound(&self, cell: &Aabb) -> Option<f64> {
        self.0.bound(cell)
    }

    fn is_open(&self, bound: f64) -> bool {
        self.0.is_open(bound)
    }

    fn test(&mut self, corners: &Triangle, triangle: u32) -> Result<bool, QueryError> {
        self.0.test(corners, triangle);
        Ok(true)
    }
}
