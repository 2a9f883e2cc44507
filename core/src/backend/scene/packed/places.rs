//! Where geometries lie in the arrays that they share, and how those that change get other places while the rest stay.

use alloc::vec::Vec;

use super::free::{FirstFit, FreeRanges, GivenBack};
use super::sizes::{GeometryChange, PackedSizes, SHARED, Unpackable};
use super::steps::Steps;
use crate::backend::scene::built::BuiltScene;
use crate::scene::GeometryId;
use crate::watch::{Progress, Stage, Watch};

/// Where the geometries of a scene lie in the arrays of its packed form.
///
/// A geometry has a range of each array. When some geometries change, their ranges are given back first; then each of them, in the order in
/// which they are named, gets the first free range that has room, or one at the end. So the same changes lead to the same places, and a geometry that
/// has no more nodes, references and triangles than before stays where it is, or moves towards the beginning. No hit depends on places.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PackedPlaces {
    arrays: [FreeRanges; SHARED],
    /// By the names of geometries.
    geometries: Vec<Option<Place>>,
    /// Entries that geometries have of each array.
    used: [usize; SHARED],
}

/// The ranges of a geometry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    firsts: [usize; SHARED],
    counts: [usize; SHARED],
}

impl PackedPlaces {
    /// One geometry behind the other, in the order of their names.
    ///
    /// # Errors
    /// No memory, or more than can be named.
    pub fn of(scene: &BuiltScene) -> Result<PackedPlaces, Unpackable> {
        let mut own = PackedPlaces::default();
        own.make_room(scene.geometries.len())?;
        let mut room: [FirstFit; SHARED] = Default::default();
        let steps = &mut Steps::new(None, progress(0));
        for (name, geometry) in scene.geometries() {
            let sizes = PackedSizes::default().and(geometry, geometry.opacity());
            own.take(name, &sizes, &mut room, steps)?;
        }
        own.arrays = room.map(FirstFit::rest);
        own.ends().check()?;
        Ok(own)
    }

    /// The places once these geometries have changed. Each geometry is named once.
    ///
    /// # Errors
    /// No memory, or more than can be named.
    pub fn after(&self, changes: &[GeometryChange]) -> Result<PackedPlaces, Unpackable> {
        self.after_watched(changes, None)
    }

    /// [`PackedPlaces::after`] with a watch, which is called between every few thousand steps. A change takes as many steps as the logarithm of the number of
    /// changes and free ranges.
    ///
    /// # Errors
    /// As for [`PackedPlaces::after`], and [`Unpackable::Cancelled`].
    pub fn after_watched(
        &self,
        changes: &[GeometryChange],
        watch: Option<&dyn Watch>,
    ) -> Result<PackedPlaces, Unpackable> {
        let new = changes.iter().filter(|change| change.sizes.is_some()).count();
        self.after_counted(changes, &mut Steps::new(watch, progress(new as u64)))
    }

    fn after_counted(
        &self,
        changes: &[GeometryChange],
        steps: &mut Steps<'_>,
    ) -> Result<PackedPlaces, Unpackable> {
        let mut own = PackedPlaces { used: self.used, ..PackedPlaces::default() };
        let names = changes.iter().map(|change| change.geometry.0 as usize + 1).max();
        own.make_room(self.geometries.len().max(names.unwrap_or(0)))?;
        own.geometries[..self.geometries.len()].copy_from_slice(&self.geometries);
        let mut given_back: [GivenBack; SHARED] = Default::default();
        for list in &mut given_back {
            *list = GivenBack::with_room(changes.len())?;
        }
        for change in changes {
            steps.take(1)?;
            own.give_back(change.geometry, &mut given_back);
        }
        for (array, given_back) in given_back.into_iter().enumerate() {
            own.arrays[array] = self.arrays[array].with(given_back, steps)?;
        }
        let mut new = changes.iter().filter_map(|own| Some((own.geometry, own.sizes?))).peekable();
        if new.peek().is_some() {
            let mut room: [FirstFit; SHARED] = Default::default();
            for (room, free) in room.iter_mut().zip(&mut own.arrays) {
                *room = FirstFit::of(core::mem::take(free), steps)?;
            }
            for (geometry, sizes) in new {
                own.take(geometry, &sizes, &mut room, steps)?;
            }
            own.arrays = room.map(FirstFit::rest);
        }
        own.ends().check()?;
        Ok(own)
    }

    /// How long the arrays must be: up to the end of the last geometry in each of them. There are no instances in these sizes, and no nodes of the tree
    /// over them.
    pub fn ends(&self) -> PackedSizes {
        sizes_of([0, 1, 2, 3].map(|array: usize| self.arrays[array].end()))
    }

    /// What of the arrays is in use: [`PackedPlaces::ends`] without free ranges.
    pub fn used(&self) -> PackedSizes {
        sizes_of(self.used)
    }

    /// Where a geometry begins among all nodes, references, triangles and blocks of shapes; `None` where it has no place.
    pub fn firsts(&self, geometry: GeometryId) -> Option<[usize; SHARED]> {
        Some(self.place(geometry)?.firsts)
    }

    /// How many nodes, references, triangles and blocks of shapes there is room for at a geometry's place.
    pub(super) fn counts(&self, geometry: GeometryId) -> Option<[usize; SHARED]> {
        Some(self.place(geometry)?.counts)
    }

    fn place(&self, geometry: GeometryId) -> Option<&Place> {
        self.geometries.get(geometry.0 as usize)?.as_ref()
    }

    fn make_room(&mut self, names: usize) -> Result<(), Unpackable> {
        let needed = (names * size_of::<Option<Place>>()) as u64;
        let lacking = |_| Unpackable::Memory { needed };
        self.geometries.try_reserve_exact(names).map_err(lacking)?;
        self.geometries.resize(names, None);
        Ok(())
    }

    fn take(
        &mut self,
        geometry: GeometryId,
        sizes: &PackedSizes,
        room: &mut [FirstFit; SHARED],
        steps: &mut Steps<'_>,
    ) -> Result<(), Unpackable> {
        let (mut firsts, counts) = ([0; SHARED], sizes.shared());
        for array in 0..SHARED {
            firsts[array] = room[array].take(counts[array], steps)?;
            self.used[array] += counts[array];
        }
        self.geometries[geometry.0 as usize] = Some(Place { firsts, counts });
        Ok(())
    }

    fn give_back(&mut self, geometry: GeometryId, to: &mut [GivenBack; SHARED]) {
        let Some(Place { firsts, counts }) = self.geometries[geometry.0 as usize].take() else {
            return;
        };
        for array in 0..SHARED {
            to[array].push(firsts[array]..firsts[array] + counts[array]);
            self.used[array] -= counts[array];
        }
    }
}

/// What a watch is told while so many geometries, all of which are built, get their places.
fn progress(geometries: u64) -> Progress {
    Progress { stage: Stage::Geometries, done: geometries, total: geometries }
}

fn sizes_of([nodes, references, triangles, shapes]: [usize; SHARED]) -> PackedSizes {
    PackedSizes { nodes, references, triangles, shapes, ..PackedSizes::default() }
}

#[cfg(test)]
mod tests {
    use super::super::steps::STEPS;
    use super::*;
    use crate::random::hash;
    use core::ops::ControlFlow;
    use core::sync::atomic::{AtomicU64, Ordering::Relaxed};

    /// Geometries of one entry of each array, of which every second one then grows: what they leave has room for none of them.
    fn growth(count: u32) -> (PackedPlaces, Vec<GeometryChange>) {
        let all: Vec<_> = (0..count).map(|name| change(name, Some([1; SHARED]))).collect();
        let places = PackedPlaces::default().after(&all).unwrap();
        (places, (0..count).step_by(2).map(|name| change(name, Some([2; SHARED]))).collect())
    }

    /// Geometries of one and of two entries, of which every second one then takes what another one leaves: all find a range.
    fn exchange(count: u32) -> (PackedPlaces, Vec<GeometryChange>) {
        let size = |name: u32| 1 + name as usize / 2 % 2;
        let all: Vec<_> = (0..count).map(|name| change(name, Some([size(name); SHARED]))).collect();
        let places = PackedPlaces::default().after(&all).unwrap();
        let becomes = |name: u32| change(name, Some([3 - size(name); SHARED]));
        (places, (0..count).step_by(2).map(becomes).collect())
    }

    /// The places that [`PackedPlaces::after`] has to find, by a look at each free range, and the steps that this takes.
    fn after_by_scan(was: &PackedPlaces, changes: &[GeometryChange]) -> (PackedPlaces, u64) {
        let gone: Vec<_> = changes.iter().map(|own| change(own.geometry.0, None)).collect();
        let (mut own, mut steps) = (was.after(&gone).unwrap(), 0);
        for change in changes {
            let Some(sizes) = &change.sizes else { continue };
            let (mut firsts, counts) = ([0; SHARED], sizes.shared());
            for array in 0..SHARED {
                firsts[array] = own.arrays[array].take_by_scan(counts[array], &mut steps);
                own.used[array] += counts[array];
            }
            own.geometries[change.geometry.0 as usize] = Some(Place { firsts, counts });
        }
        (own, steps)
    }

    fn most_steps(changes: usize) -> u64 {
        4 * SHARED as u64 * changes as u64 * u64::from(changes.ilog2() + 1)
    }

    /// Counted, so that it does not depend on the machine. The scan in place of the tree would take too many.
    #[test]
    fn many_that_grow_take_few_steps_each() {
        let cases = [(growth(400_000), 800_000), (exchange(400_000), 600_000)];
        for ((places, changes), end) in cases {
            let mut steps = Steps::new(None, progress(0));
            let after = places.after_counted(&changes, &mut steps).unwrap();
            assert_eq!((after.used().nodes, after.ends().nodes), (600_000, end));
            let most = most_steps(changes.len());
            assert!(steps.taken() <= most, "{} {most}", steps.taken());
        }
        let (places, changes) = growth(8_000);
        let (scanned, steps) = after_by_scan(&places, &changes);
        assert!(steps > most_steps(changes.len()), "{steps}");
        assert_eq!(places.after(&changes).unwrap(), scanned);
    }

    #[test]
    fn places_are_those_of_a_scan() {
        let mut places = PackedPlaces::default();
        let mut most_free = 0;
        for seed in 0..60 {
            let sizes =
                |name: u32| [0, 1, 2, 3].map(|i| hash(seed, &[name.into(), i]) as usize % 9);
            let is_named = |name: &u32| hash(seed, &[u64::from(*name), 4]).is_multiple_of(3);
            let goes = |name: u32| hash(seed, &[name.into(), 5]).is_multiple_of(4);
            let changes: Vec<_> = (0..200)
                .filter(is_named)
                .map(|name| change(name, (!goes(name)).then(|| sizes(name))))
                .collect();
            let (scanned, _) = after_by_scan(&places, &changes);
            places = places.after(&changes).unwrap();
            assert_eq!(places, scanned, "{seed}");
            most_free = most_free.max(places.ends().nodes - places.used().nodes);
        }
        assert!(most_free > 50, "{most_free}");
    }

    /// The watch is called between every few steps, and wherever it says so the work ends.
    #[test]
    fn a_watch_ends_it_anywhere() {
        let (places, changes) = growth(20_000);
        let mut steps = Steps::new(None, progress(0));
        places.after_counted(&changes, &mut steps).unwrap();
        let calls = |most: u64| {
            let seen = AtomicU64::new(0);
            let watch = |own: &Progress| {
                assert_eq!((own.stage, own.done, own.total), (Stage::Geometries, 10_000, 10_000));
                match seen.fetch_add(1, Relaxed) + 1 < most {
                    true => ControlFlow::Continue(()),
                    false => ControlFlow::Break(()),
                }
            };
            let after = places.after_watched(&changes, Some(&watch));
            (after.map(drop), seen.into_inner())
        };
        let (all, most) = calls(u64::MAX);
        assert_eq!(all, Ok(()));
        assert_eq!(most, steps.taken() / STEPS);
        assert!(most >= 10, "{most}");
        for call in 1..=most {
            let cancelled = Unpackable::Cancelled { progress: progress(10_000) };
            assert_eq!(calls(call), (Err(cancelled), call));
        }
    }

    fn change(name: u32, sizes: Option<[usize; SHARED]>) -> GeometryChange {
        GeometryChange { geometry: GeometryId(name), sizes: sizes.map(sizes_of) }
    }

    /// What fits stays, what grows goes elsewhere, and what others gave back in the same change is free.
    #[test]
    fn geometries_stay_where_they_fit() {
        let all = [4, 3, 5].map(|count| Some([count, 2 * count, count, 0]));
        let changes: Vec<_> = (0..).zip(all).map(|(name, own)| change(name, own)).collect();
        let places = PackedPlaces::default().after(&changes).unwrap();
        let firsts = |places: &PackedPlaces, name| places.firsts(GeometryId(name)).unwrap();
        assert_eq!([0, 1, 2].map(|name| firsts(&places, name)[0]), [0, 4, 7]);
        assert_eq!((places.ends(), places.used()), (places.used(), sizes_of([12, 24, 12, 0])));
        // One fewer of one array, one more of another.
        let moved = places.after(&[change(1, Some([2, 7, 3, 0]))]).unwrap();
        assert_eq!(firsts(&moved, 1), [4, 24, 4, 0]);
        assert_eq!(moved.ends(), sizes_of([12, 31, 12, 0]));
        assert_eq!(moved.used(), sizes_of([11, 25, 12, 0]));
        for other in [0, 2] {
            assert_eq!(firsts(&moved, other), firsts(&places, other));
        }
        let gone = moved.after(&[change(0, None), change(5, Some([5, 1, 1, 2]))]).unwrap();
        assert_eq!((gone.firsts(GeometryId(0)), firsts(&gone, 5)), (None, [12, 0, 0, 0]));
        let fresh = places.after(&(0..3).map(|name| change(name, None)).collect::<Vec<_>>());
        let fresh = fresh.unwrap();
        assert_eq!((fresh.ends(), fresh.used()), (sizes_of([0; SHARED]), sizes_of([0; SHARED])));
        let error = places.after(&[change(3, Some([0, 0, 0, usize::from(u16::MAX) << 16]))]);
        assert!(matches!(error, Err(Unpackable::TooMany { .. })), "{error:?}");
    }
}
