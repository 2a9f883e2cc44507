//! Instances and triangles of instances that rays pass.
//!
//! The library's filters may be functions of a hit; from Python they are lists. A function in Python would be called for each hit that comes up, by all threads, one at a
//! time under the GIL: a microsecond each, where a ray takes a tenth of that.

use numpy::PyReadonlyArray2;
use splitplane::objects::{Filter, SceneHit};

use crate::arrays::rows;
use crate::failure::Failure;

/// In place of a triangle: all of the instance.
const ALL: u32 = u32::MAX;

/// Pairs of instance and triangle, in order.
pub(crate) struct IgnoredList {
    /// Instances of which all is ignored.
    whole: Vec<u32>,
    pairs: Vec<(u32, u32)>,
}

impl IgnoredList {
    pub(crate) fn new(array: &PyReadonlyArray2<'_, u32>) -> Result<IgnoredList, Failure> {
        let given = rows::<u32, 2>(array, "ignore")?;
        let (mut whole, mut pairs) = (Vec::new(), Vec::new());
        let all = given.iter().filter(|own| own[1] == ALL).count();
        let refused = |_| Failure::memory(8 * given.len());
        whole.try_reserve_exact(all).map_err(refused)?;
        pairs.try_reserve_exact(given.len() - all).map_err(refused)?;
        for &[instance, triangle] in given {
            match triangle == ALL {
                true => whole.push(instance),
                false => pairs.push((instance, triangle)),
            }
        }
        whole.sort_unstable();
        pairs.sort_unstable();
        Ok(IgnoredList { whole, pairs })
    }
}

impl Filter for IgnoredList {
    fn keeps(&self, hit: &SceneHit) -> bool {
        self.whole.binary_search(&hit.instance).is_err()
            && self.pairs.binary_search(&(hit.instance, hit.triangle)).is_err()
    }
}
