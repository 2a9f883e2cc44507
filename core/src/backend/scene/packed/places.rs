//! Where geometries lie in the arrays that they share, and how those that change get other places while the rest stay.

use alloc::vec::Vec;
use core::ops::Range;

use super::sizes::{GeometryChange, PackedSizes, SHARED, Unpackable};
use crate::backend::scene::built::BuiltScene;
use crate::scene::GeometryId;

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
        for (name, geometry) in scene.geometries() {
            let sizes = PackedSizes::default().and(geometry, geometry.opacity());
            own.take(name, &sizes);
        }
        own.ends().check()?;
        Ok(own)
    }

    /// The places once these geometries have changed. Each geometry is named once.
    ///
    /// # Errors
    /// No memory, or more than can be named.
    pub fn after(&self, changes: &[GeometryChange]) -> Result<PackedPlaces, Unpackable> {
        let mut own = PackedPlaces { used: self.used, ..PackedPlaces::default() };
        let names = changes.iter().map(|change| change.geometry.0 as usize + 1).max();
        own.make_room(self.geometries.len().max(names.unwrap_or(0)))?;
        own.geometries[..self.geometries.len()].copy_from_slice(&self.geometries);
        for (own, was) in own.arrays.iter_mut().zip(&self.arrays) {
            // Each change gives back one range at most.
            own.reserve(was.holes.len() + changes.len())?;
            own.holes.extend_from_slice(&was.holes);
            own.end = was.end;
        }
        for change in changes {
            own.give_back(change.geometry);
        }
        for change in changes {
            if let Some(sizes) = &change.sizes {
                own.take(change.geometry, sizes);
            }
        }
        own.ends().check()?;
        Ok(own)
    }

    /// How long the arrays must be: up to the end of the last geometry in each of them. There are no instances in these sizes, and no nodes of the tree
    /// over them.
    pub fn ends(&self) -> PackedSizes {
        sizes_of([0, 1, 2, 3].map(|array: usize| self.arrays[array].end))
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

    fn take(&mut self, geometry: GeometryId, sizes: &PackedSizes) {
        let counts = sizes.shared();
        let firsts = [0, 1, 2, 3].map(|array: usize| self.arrays[array].take(counts[array]));
        self.geometries[geometry.0 as usize] = Some(Place { firsts, counts });
        for (used, count) in self.used.iter_mut().zip(counts) {
            *used += count;
        }
    }

    fn give_back(&mut self, geometry: GeometryId) {
        let Some(Place { firsts, counts }) = self.geometries[geometry.0 as usize].take() else {
            return;
        };
        for array in 0..SHARED {
            self.arrays[array].give_back(firsts[array]..firsts[array] + counts[array]);
            self.used[array] -= counts[array];
        }
    }
}

fn sizes_of([nodes, references, triangles, shapes]: [usize; SHARED]) -> PackedSizes {
    PackedSizes { nodes, references, triangles, shapes, ..PackedSizes::default() }
}

/// What is free of an array.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct FreeRanges {
    /// In ascending order. None is empty, none touches another, and none touches the end.
    holes: Vec<Range<usize>>,
    /// Nothing is in use from here on.
    end: usize,
}

impl FreeRanges {
    fn reserve(&mut self, holes: usize) -> Result<(), Unpackable> {
        let needed = (holes * size_of::<Range<usize>>()) as u64;
        self.holes.try_reserve_exact(holes).map_err(|_| Unpackable::Memory { needed })
    }

    /// The first range that has room for so many; the end for none.
    fn take(&mut self, count: usize) -> usize {
        if count == 0 {
            return self.end;
        }
        let Some(at) = self.holes.iter().position(|hole| hole.len() >= count) else {
            self.end += count;
            return self.end - count;
        };
        let first = self.holes[at].start;
        if self.holes[at].len() == count {
            self.holes.remove(at);
        } else {
            self.holes[at].start += count;
        }
        first
    }

    /// Frees a range that is in use.
    fn give_back(&mut self, own: Range<usize>) {
        if own.is_empty() {
            return;
        }
        let at = self.holes.partition_point(|hole| hole.start < own.start);
        let after_hole = at > 0 && self.holes[at - 1].end == own.start;
        let before_hole = self.holes.get(at).is_some_and(|hole| hole.start == own.end);
        let merged = if after_hole { self.holes[at - 1].start } else { own.start }
            ..if before_hole { self.holes[at].end } else { own.end };
        let replaced = at - usize::from(after_hole)..at + usize::from(before_hole);
        if merged.end == self.end {
            self.end = merged.start;
            self.holes.drain(replaced);
        } else {
            self.holes.splice(replaced, [merged]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::hash;
    use alloc::vec;

    /// Where a range of so many begins, by looking at each entry.
    fn first_fit(taken: &[bool], count: usize) -> usize {
        let free = |first: usize| taken[first..].iter().take(count).all(|taken| !taken);
        (0..=taken.len()).find(|&first| free(first)).unwrap()
    }

    /// Random takes and gives against an array of what is taken. `fault` changes what is given back.
    fn run(seed: u64, fault: impl Fn(Range<usize>) -> Range<usize>) -> Result<usize, &'static str> {
        let (mut own, mut taken, mut ranges) = (FreeRanges::default(), Vec::new(), Vec::new());
        let mut most_holes = 0;
        for step in 0..600u64 {
            let random = |what| hash(seed, &[step, what]) as usize;
            // More come at first, and more go later.
            if random(0) % 600 >= step as usize || ranges.is_empty() {
                let count = random(1) % 9;
                let expected = if count == 0 { own.end } else { first_fit(&taken, count) };
                if own.take(count) != expected {
                    return Err("another place");
                }
                taken.resize(taken.len().max(expected + count), false);
                if taken[expected..][..count].contains(&true) {
                    return Err("an overlap");
                }
                taken[expected..][..count].fill(true);
                if count > 0 {
                    ranges.push(expected..expected + count);
                }
            } else {
                let gone: Range<usize> = ranges.swap_remove(random(2) % ranges.len());
                taken[gone.clone()].fill(false);
                own.give_back(fault(gone));
            }
            let end = taken.iter().rposition(|taken| *taken).map_or(0, |last| last + 1);
            if own.end != end {
                return Err("another end");
            }
            taken.truncate(end);
            let mut holes: Vec<Range<usize>> = vec![];
            for at in (0..end).filter(|&at| !taken[at]) {
                match holes.last_mut() {
                    Some(hole) if hole.end == at => hole.end += 1,
                    _ => holes.push(at..at + 1),
                }
            }
            if own.holes != holes {
                return Err("other holes");
            }
            most_holes = most_holes.max(holes.len());
        }
        Ok(most_holes)
    }

    #[test]
    fn ranges_are_those_of_a_model() {
        let most = (0..50).map(|seed| run(seed, |gone| gone).unwrap()).max();
        assert!(most.is_some_and(|most| most > 20), "{most:?}");
    }

    #[test]
    fn planted_faults_are_found() {
        let faults: [fn(Range<usize>) -> Range<usize>; 4] = [
            |gone| gone.start..gone.start,
            |gone| gone.start..gone.end.saturating_sub(1).max(gone.start),
            |gone| gone.start..gone.end + 1,
            |gone| gone.start + 1..gone.end + 1,
        ];
        for (which, fault) in faults.into_iter().enumerate() {
            assert!((0..50).any(|seed| run(seed, fault).is_err()), "{which}");
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
