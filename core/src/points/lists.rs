//! Lists of points, one for each query of a batch.

use crate::error::{QueryError, check_bytes, refused};
use crate::points::nearest::Neighbour;
use crate::report::QueryReport;
use alloc::vec::Vec;

/// The points within a radius of each query of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct NeighbourLists {
    /// Where the list of each query begins, followed by the number of all points found: one entry more than there are queries.
    pub starts: Vec<usize>,
    /// The points of all lists, query by query, those of a query by (distance, index).
    pub found: Vec<Neighbour>,
    /// Which backend answered.
    pub report: QueryReport,
}

impl Default for NeighbourLists {
    fn default() -> NeighbourLists {
        NeighbourLists { starts: Vec::from([0]), found: Vec::new(), report: QueryReport::default() }
    }
}

impl NeighbourLists {
    /// The points found for a query of the batch.
    pub fn of(&self, query: usize) -> &[Neighbour] {
        &self.found[self.starts[query]..self.starts[query + 1]]
    }

    /// How many queries there are.
    pub fn queries(&self) -> usize {
        self.starts.len() - 1
    }

    /// Bytes that both lists hold, spare capacity included.
    pub fn bytes(&self) -> u64 {
        let starts = self.starts.capacity() * size_of::<usize>();
        (starts + self.found.capacity() * size_of::<Neighbour>()) as u64
    }

    /// Appends the list of one more query, in order.
    ///
    /// # Errors
    /// More memory than `max_memory` allows, or than the system has.
    pub fn push(
        &mut self,
        list: impl ExactSizeIterator<Item = Neighbour>,
        max_memory: Option<u64>,
    ) -> Result<(), QueryError> {
        let (points, queries) = (self.found.len() + list.len(), self.starts.len() + 1);
        let needed = (points * size_of::<Neighbour>() + queries * size_of::<usize>()) as u64;
        check_bytes(needed, max_memory)?;
        self.found.try_reserve(list.len()).map_err(|_| refused(needed))?;
        self.starts.try_reserve(1).map_err(|_| refused(needed))?;
        self.found.extend(list);
        self.starts.push(self.found.len());
        Ok(())
    }
}
