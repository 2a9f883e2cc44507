//! The order in which points are asked for: neighbours one after the other, since a search begins with a guess from the one before, and
//! reads what is in the caches. No answer depends on it.

use rayon::prelude::*;

use crate::arrays::reserved;
use crate::failure::Failure;

/// Fewer points are asked for as they come.
const FEW: usize = 1 << 10;
/// Cells of an axis.
const CELLS: f32 = 1024.0;

/// Points in the order of a curve (Morton 1966), and the place that each has among those given.
pub(crate) struct Ordered {
    pub points: Vec<[f32; 3]>,
    pub places: Vec<u32>,
}

/// Orders points that are many; `None` for few.
pub(crate) fn ordered(given: &[[f32; 3]]) -> Result<Option<Ordered>, Failure> {
    if given.len() < FEW {
        return Ok(None);
    }
    let none = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    let joined = |a: ([f32; 3], [f32; 3]), b: ([f32; 3], [f32; 3])| {
        (
            [0, 1, 2].map(|axis| a.0[axis].min(b.0[axis])),
            [0, 1, 2].map(|axis| a.1[axis].max(b.1[axis])),
        )
    };
    let finite = |point: &&[f32; 3]| point.iter().all(|x| x.is_finite());
    let (lower, upper) =
        given.par_iter().filter(finite).map(|point| (*point, *point)).reduce(|| none, joined);
    let scale = [0, 1, 2].map(|axis| CELLS / (upper[axis] - lower[axis]));
    let mut keys = reserved(given.len(), 0u64)?;
    keys.par_iter_mut().zip(given).enumerate().for_each(|(place, (key, point))| {
        let mut code = 0;
        for axis in 0..3 {
            // The conversion saturates, and takes a NaN for 0.
            let cell = ((point[axis] - lower[axis]) * scale[axis]) as u32;
            code |= spread(cell.min(CELLS as u32 - 1)) << axis;
        }
        *key = u64::from(code) << 32 | place as u64;
    });
    keys.par_sort_unstable();
    let (mut points, mut places) = (reserved(given.len(), [0.0; 3])?, reserved(given.len(), 0)?);
    let outs = points.par_iter_mut().zip(&mut places);
    outs.zip(&keys).for_each(|((point, place), &key)| {
        *place = key as u32;
        *point = given[key as u32 as usize];
    });
    Ok(Some(Ordered { points, places }))
}

/// Ten bits, two empty ones between each.
fn spread(x: u32) -> u32 {
    let x = (x | x << 16) & 0x0300_00ff;
    let x = (x | x << 8) & 0x0300_f00f;
    let x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}
