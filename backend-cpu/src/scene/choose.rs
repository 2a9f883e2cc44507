//! Which way a batch's rays are followed, by the layout of geometries and by what is asked.

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::backend::QueryLayout;
use splitplane_core::backend::scene::SceneAnswer;
use splitplane_core::ray::Accuracy;

use super::batch::{SceneBatch, Work};
use super::in_turn::{InTurn, serves};
use super::parts::all_count;
use super::stream::Flying;
use crate::simd::{Compiled, Simd};
use crate::trace::leaves::{IndexedLeaves, PackedLeaves};

impl<T: SceneAnswer> Compiled for SceneBatch<'_, T> {
    /// An error where there is no memory for the rays under way.
    type Output = Result<Work, TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<Work, TryReserveError> {
        let usual =
            self.options.accuracy == Accuracy::Watertight && all_count(self.scene, self.options);
        // SAFETY: the caller's contract.
        unsafe {
            let compact = self.geometries.layout == QueryLayout::Compact;
            if S::SPECIALISED && usual && serves(&self) {
                return if compact {
                    S::call(InTurn::<T, IndexedLeaves<'_>> { batch: self, of: PhantomData })
                } else {
                    S::call(InTurn::<T, PackedLeaves<'_>> { batch: self, of: PhantomData })
                };
            }
            if compact {
                S::call(Flying::<T, IndexedLeaves<'_>>::new(self))
            } else {
                S::call(Flying::<T, PackedLeaves<'_>>::new(self))
            }
        }
    }
}
