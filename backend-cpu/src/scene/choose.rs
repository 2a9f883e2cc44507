//! Which way a batch's rays are followed, by the layout of geometries and by what is asked.

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::backend::QueryLayout;
use splitplane_core::backend::scene::SceneAnswer;
use splitplane_core::ray::Accuracy;

use super::batch::{SceneBatch, Work};
use super::counting::{EveryHit, KeptHits};
use super::in_turn::{InTurn, serves};
use super::parts::all_count;
use super::stream::Flying;
use crate::simd::{Compiled, Simd};
use crate::trace::leaves::{IndexedLeaves, PackedLeaves};

/// Whether watertight rays whose hits all count have a way of their own ([`InTurn`]). A page loads what that takes, more than a tenth of all it loads for rays:
/// there they do not.
const IN_TURN: bool = !cfg!(target_family = "wasm");

/// Whether scenes all of whose hits count have functions of their own.
const EVERY_HIT: bool = !cfg!(target_family = "wasm");

impl<T: SceneAnswer> Compiled for SceneBatch<'_, T> {
    /// An error where there is no memory for the rays under way.
    type Output = Result<Work, TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<Work, TryReserveError> {
        let all = all_count(self.scene, self.options);
        let usual = all && self.options.accuracy == Accuracy::Watertight;
        // SAFETY: the caller's contract.
        unsafe {
            match (self.geometries.layout, all) {
                (QueryLayout::Compact, _) if IN_TURN && usual && serves(&self) => {
                    let of = PhantomData::<IndexedLeaves<'_>>;
                    S::call(InTurn { batch: self, of })
                }
                (_, _) if IN_TURN && usual && serves(&self) => {
                    let of = PhantomData::<PackedLeaves<'_>>;
                    S::call(InTurn { batch: self, of })
                }
                // A page loads each of these: there a layout has one, which tells each hit whether it counts.
                (QueryLayout::Compact, true) if EVERY_HIT => {
                    S::call(Flying::<T, IndexedLeaves<'_>, EveryHit>::new(self))
                }
                (QueryLayout::Compact, _) => {
                    S::call(Flying::<T, IndexedLeaves<'_>, KeptHits>::new(self))
                }
                (_, true) if EVERY_HIT => {
                    S::call(Flying::<T, PackedLeaves<'_>, EveryHit>::new(self))
                }
                (_, _) => S::call(Flying::<T, PackedLeaves<'_>, KeptHits>::new(self)),
            }
        }
    }
}
