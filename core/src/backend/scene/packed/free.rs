//! What is free of an array, and where something new finds room.

use alloc::collections::BinaryHeap;
use alloc::vec::Vec;
use core::cmp::Reverse;
use core::ops::Range;

use super::sizes::Unpackable;
use super::steps::Steps;

/// What is free of an array.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct FreeRanges {
    /// In ascending order. None is empty, none touches another, and none touches the end.
    holes: Vec<Range<usize>>,
    /// Nothing is in use from here on.
    end: usize,
}

/// Ranges that are given back, in any order.
#[derive(Default)]
pub(super) struct GivenBack(Vec<Reverse<(usize, usize)>>);

impl GivenBack {
    /// Room for so many.
    pub(super) fn with_room(ranges: usize) -> Result<GivenBack, Unpackable> {
        Ok(GivenBack(list_of(ranges)?))
    }

    /// One more, which is in use.
    pub(super) fn push(&mut self, own: Range<usize>) {
        if !own.is_empty() {
            self.0.push(Reverse((own.start, own.end)));
        }
    }
}

impl FreeRanges {
    /// Nothing is in use from here on.
    pub(super) fn end(&self) -> usize {
        self.end
    }

    /// What is free once these ranges are too. They are merged in ascending order, each in as many steps as a heap has levels.
    pub(super) fn with(
        &self,
        given_back: GivenBack,
        steps: &mut Steps<'_>,
    ) -> Result<FreeRanges, Unpackable> {
        let GivenBack(new) = given_back;
        let mut own = FreeRanges { holes: list_of(self.holes.len() + new.len())?, end: self.end };
        let (mut was, mut new) = (self.holes.iter().cloned().peekable(), BinaryHeap::from(new));
        loop {
            steps.take(1)?;
            let given = new.peek().map(|Reverse((start, end))| *start..*end);
            let next = match (was.peek(), given) {
                (Some(hole), Some(given)) if given.start < hole.start => given,
                (None, Some(given)) => given,
                (Some(_), _) => {
                    own.holes.extend(was.next());
                    own.merge_last();
                    continue;
                }
                (None, None) => break,
            };
            steps.take(levels(new.len()))?;
            new.pop();
            own.holes.push(next);
            own.merge_last();
        }
        if let Some(last) = own.holes.pop_if(|last| last.end == self.end) {
            own.end = last.start;
        }
        Ok(own)
    }

    /// What [`FirstFit::take`] does, by a look at each hole. Counts the steps.
    #[cfg(test)]
    pub(super) fn take_by_scan(&mut self, count: usize, steps: &mut u64) -> usize {
        if count == 0 {
            return self.end;
        }
        let found = self.holes.iter().position(|hole| hole.len() >= count);
        *steps += found.map_or(self.holes.len(), |at| at + 1) as u64;
        let Some(at) = found else {
            self.end += count;
            return self.end - count;
        };
        self.holes[at].start += count;
        let first = self.holes[at].start - count;
        if self.holes[at].is_empty() {
            self.holes.remove(at);
        }
        first
    }

    /// Joins the last hole to the one before it where they touch.
    fn merge_last(&mut self) {
        if let [.., before, last] = &mut self.holes[..]
            && before.end == last.start
        {
            before.end = last.end;
            self.holes.pop();
        }
    }
}

/// Finds the first range that has room, in as many steps as a tree over all free ranges has levels.
#[derive(Default)]
pub(super) struct FirstFit {
    /// Some of the holes are empty, and keep their places, until all is done.
    free: FreeRanges,
    /// A binary tree over the holes, its root at 1 and the children of `n` at `2 n` and `2 n + 1`: how long the longest hole below is.
    longest: Vec<usize>,
}

impl FirstFit {
    pub(super) fn of(free: FreeRanges, steps: &mut Steps<'_>) -> Result<FirstFit, Unpackable> {
        let mut longest = Vec::new();
        if !free.holes.is_empty() {
            let leaves = free.holes.len().next_power_of_two();
            longest = list_of(2 * leaves)?;
            longest.resize(leaves, 0);
            longest.extend(free.holes.iter().map(Range::len));
            longest.resize(2 * leaves, 0);
            for node in (1..leaves).rev() {
                steps.take(1)?;
                longest[node] = longest[2 * node].max(longest[2 * node + 1]);
            }
        }
        Ok(FirstFit { free, longest })
    }

    /// Where the first range begins that has room for so many, which is taken; the end for none.
    pub(super) fn take(
        &mut self,
        count: usize,
        steps: &mut Steps<'_>,
    ) -> Result<usize, Unpackable> {
        steps.take(1)?;
        if count == 0 {
            return Ok(self.free.end);
        }
        if self.longest.get(1).is_none_or(|longest| *longest < count) {
            self.free.end += count;
            return Ok(self.free.end - count);
        }
        let leaves = self.longest.len() / 2;
        steps.take(2 * levels(leaves))?;
        let mut node = 1;
        while node < leaves {
            // What is not in the left half is in the right one.
            node = 2 * node + usize::from(self.longest[2 * node] < count);
        }
        let hole = &mut self.free.holes[node - leaves];
        let first = hole.start;
        hole.start += count;
        self.longest[node] = hole.len();
        while node > 1 {
            node /= 2;
            self.longest[node] = self.longest[2 * node].max(self.longest[2 * node + 1]);
        }
        Ok(first)
    }

    /// What is free now.
    pub(super) fn rest(self) -> FreeRanges {
        let mut free = self.free;
        free.holes.retain(|hole| !hole.is_empty());
        free
    }
}

/// Levels of a binary tree of so many nodes.
fn levels(nodes: usize) -> u64 {
    u64::from(usize::BITS - nodes.leading_zeros())
}

/// An empty list with room for so many.
fn list_of<T>(most: usize) -> Result<Vec<T>, Unpackable> {
    let mut list = Vec::new();
    let needed = most.saturating_mul(size_of::<T>()) as u64;
    list.try_reserve_exact(most).map_err(|_| Unpackable::Memory { needed })?;
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::hash;
    use crate::watch::Stage;
    use alloc::vec;

    fn steps() -> Steps<'static> {
        let progress = crate::watch::Progress { stage: Stage::Geometries, done: 0, total: 0 };
        Steps::new(None, progress)
    }

    /// Where a range of so many begins, by looking at each entry.
    fn first_fit(taken: &[bool], count: usize) -> usize {
        let free = |first: usize| taken[first..].iter().take(count).all(|taken| !taken);
        (0..=taken.len()).find(|&first| free(first)).unwrap()
    }

    /// Random gives and takes, some of each at a time, against an array of what is taken. `fault` changes what is given back.
    fn run(seed: u64, fault: impl Fn(Range<usize>) -> Range<usize>) -> Result<usize, &'static str> {
        let (mut own, mut taken, mut ranges) = (FreeRanges::default(), Vec::new(), Vec::new());
        let mut most_holes = 0;
        for step in 0..200u64 {
            let random = |what| hash(seed, &[step, what]) as usize;
            let mut back = GivenBack::with_room(4).unwrap();
            // More come at first, and more go later.
            for one in 0..4 {
                if random(one) % 200 < step as usize && !ranges.is_empty() {
                    let gone: Range<usize> = ranges.swap_remove(random(4 + one) % ranges.len());
                    taken[gone.clone()].fill(false);
                    back.push(fault(gone));
                }
            }
            let mut fit =
                FirstFit::of(own.with(back, &mut steps()).unwrap(), &mut steps()).unwrap();
            truncate(&mut taken);
            for one in 0..4 {
                if random(one) % 200 >= step as usize {
                    let count = random(8 + one) % 9;
                    let expected = if count == 0 { taken.len() } else { first_fit(&taken, count) };
                    if fit.take(count, &mut steps()) != Ok(expected) {
                        return Err("another place");
                    }
                    taken.resize(taken.len().max(expected + count), false);
                    taken[expected..][..count].fill(true);
                    if count > 0 {
                        ranges.push(expected..expected + count);
                    }
                }
            }
            own = fit.rest();
            if own.end != taken.len() {
                return Err("another end");
            }
            let mut holes: Vec<Range<usize>> = vec![];
            for at in (0..own.end).filter(|&at| !taken[at]) {
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

    fn truncate(taken: &mut Vec<bool>) {
        taken.truncate(taken.iter().rposition(|taken| *taken).map_or(0, |last| last + 1));
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
}
