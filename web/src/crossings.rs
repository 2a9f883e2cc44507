//! All hits of a batch, as arrays.

use splitplane::{AllHits, Hit};
use wasm_bindgen::prelude::*;

use crate::failure::Failure;
use crate::words::{Words, zeros};

/// Crossings of rays with surfaces.
#[wasm_bindgen]
pub struct Crossings {
    starts: Option<Words>,
    crossings: Option<Words>,
}

#[wasm_bindgen]
impl Crossings {
    /// Where those of each ray begin, and how many there are. Once only.
    pub fn starts(&mut self) -> Option<Words> {
        self.starts.take()
    }

    /// 5 words each: t, triangle, u, v, and 1 where the ray comes from the front. Once only.
    pub fn crossings(&mut self) -> Option<Words> {
        self.crossings.take()
    }
}

impl Crossings {
    pub(crate) fn of(all: &AllHits) -> Result<Crossings, Failure> {
        let mut starts = zeros(all.starts.len())?;
        for (to, start) in starts.iter_mut().zip(&all.starts) {
            *to = *start as u32;
        }
        let mut crossings: Vec<[u32; 5]> = zeros(all.crossings.len())?;
        for (to, crossing) in crossings.iter_mut().zip(&all.crossings) {
            let Hit { t, triangle, u, v } = crossing.hit;
            *to = [t.to_bits(), triangle, u.to_bits(), v.to_bits(), u32::from(crossing.front)];
        }
        Ok(Crossings {
            starts: Some(Words::of(starts)),
            crossings: Some(Words::of(bytemuck::allocation::cast_vec(crossings))),
        })
    }
}
