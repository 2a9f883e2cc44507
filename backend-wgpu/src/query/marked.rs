//! The rays of a batch to which the device has no answer.

use splitplane_core::ray::Hit;

use super::error::DeviceQueryError;
use super::layout::{DEFERRED, UNFINISHED, UNSETTLED};

/// Indices of the rays of a batch that have no answer, in ascending order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Marked {
    /// Those that were not followed to their end: the driver ended the walk, or no retry took up what a lean kernel had left.
    pub unfinished: Vec<usize>,
    /// Those that bounds of error leave undecided; accuracy `exact` only.
    pub undecided: Vec<usize>,
}

impl Marked {
    /// Notes a ray of which the device says that this is its hit.
    pub(super) fn note_hit(&mut self, ray: usize, hit: &Hit) -> Result<(), DeviceQueryError> {
        match hit.triangle {
            UNFINISHED | DEFERRED | UNSETTLED => push(&mut self.unfinished, ray),
            Hit::UNDECIDED => push(&mut self.undecided, ray),
            _ => Ok(()),
        }
    }

    /// Notes a ray of which the device says this word; returns whether it hits anything, as far as that is known.
    pub(super) fn note_any(&mut self, ray: usize, word: u32) -> Result<bool, DeviceQueryError> {
        match word {
            2 => push(&mut self.unfinished, ray)?,
            3 => push(&mut self.undecided, ray)?,
            _ => {}
        }
        Ok(word == 1)
    }

    /// An error when there are any.
    pub(crate) fn none(&self) -> Result<(), DeviceQueryError> {
        if let Some(&first) = self.unfinished.first() {
            return Err(DeviceQueryError::Unfinished { rays: self.unfinished.len(), first });
        }
        match self.undecided.first() {
            None => Ok(()),
            Some(&first) => Err(DeviceQueryError::Undecided { rays: self.undecided.len(), first }),
        }
    }
}

fn push(places: &mut Vec<usize>, place: usize) -> Result<(), DeviceQueryError> {
    let needed = ((places.len() + 1) * size_of::<usize>()) as u64;
    places.try_reserve(1).map_err(|_| DeviceQueryError::HostMemory { needed })?;
    places.push(place);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_that_were_not_followed_to_their_end_are_noted() {
        let mut marked = Marked::default();
        let triangles = [3, UNFINISHED, u32::MAX, DEFERRED, Hit::UNDECIDED, UNSETTLED, 0];
        for (ray, triangle) in triangles.into_iter().enumerate() {
            marked.note_hit(ray, &Hit { triangle, ..Hit::MISS }).unwrap();
        }
        assert_eq!(marked, Marked { unfinished: vec![1, 3, 5], undecided: vec![4] });
        let mut marked = Marked::default();
        let met = [0, 1, 2, 3].map(|word| marked.note_any(word as usize, word).unwrap());
        assert_eq!(met, [false, true, false, false]);
        assert_eq!(marked, Marked { unfinished: vec![2], undecided: vec![3] });
    }
}
