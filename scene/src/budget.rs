//! Memory that reading a file may hold, counted before it is taken.

use std::cell::Cell;
use std::collections::HashMap;
use std::hash::Hash;

/// Bytes that are held, and the most that may be. Lists count by their capacity, and one that grows counts twice while it moves.
pub(crate) struct Budget {
    held: Cell<u64>,
    /// What may be held beside the limit.
    free: Cell<u64>,
    limit: u64,
    /// The refusal, which a reader in between may make an error of its own of.
    refused: Cell<Option<Full>>,
}

/// Why there is no memory for something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Full {
    /// With it more bytes would be held than are allowed.
    #[cfg_attr(not(feature = "json"), allow(dead_code, reason = "who sets limits says so"))]
    Limit {
        /// Bytes of all that would be held.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// The system has none.
    System,
}

impl Budget {
    pub(crate) fn new(limit: u64) -> Budget {
        Budget { held: Cell::new(0), free: Cell::new(0), limit, refused: Cell::new(None) }
    }

    /// One that refuses nothing.
    pub(crate) fn unlimited() -> Budget {
        Budget::new(u64::MAX)
    }

    /// Counts bytes.
    ///
    /// # Errors
    /// There are too many.
    pub(crate) fn take(&self, bytes: u64) -> Result<(), Full> {
        let held = self.held.get().saturating_add(bytes);
        if held > self.limit.saturating_add(self.free.get()) {
            let needed = held - self.free.get().min(held);
            return self.refuse(Full::Limit { needed, limit: self.limit });
        }
        self.held.set(held);
        Ok(())
    }

    fn refuse(&self, why: Full) -> Result<(), Full> {
        self.refused.set(Some(why));
        Err(why)
    }

    /// Bytes that may still be taken.
    pub(crate) fn left(&self) -> u64 {
        self.limit.saturating_add(self.free.get()).saturating_sub(self.held.get())
    }

    /// Whether there is a limit at all.
    pub(crate) fn is_limited(&self) -> bool {
        self.limit < u64::MAX
    }

    /// Bytes that are not held any more.
    pub(crate) fn give(&self, bytes: u64) {
        self.held.set(self.held.get().saturating_sub(bytes));
    }

    /// Makes space in a list.
    ///
    /// # Errors
    /// There is no memory for it.
    pub(crate) fn grow<T>(&self, list: &mut Vec<T>, more: usize) -> Result<(), Full> {
        let (length, before) = (list.len(), list.capacity());
        if before - length >= more {
            return Ok(());
        }
        // As lists do by themselves, so that each value is moved a few times at most.
        self.resize(list, length.saturating_add(more).max(before.saturating_mul(2)).max(4))
    }

    fn resize<T>(&self, list: &mut Vec<T>, capacity: usize) -> Result<(), Full> {
        let before = bytes_of::<T>(list.capacity());
        self.take(bytes_of::<T>(capacity))?;
        if list.try_reserve_exact(capacity - list.len()).is_err() {
            return self.refuse(Full::System);
        }
        self.give(before);
        Ok(())
    }

    /// Adds to a list.
    ///
    /// # Errors
    /// There is no memory for it.
    pub(crate) fn push<T>(&self, list: &mut Vec<T>, value: T) -> Result<(), Full> {
        self.grow(list, 1)?;
        list.push(value);
        Ok(())
    }

    /// Makes space for one more in a table.
    ///
    /// # Errors
    /// There is no memory for it.
    pub(crate) fn grow_map<K: Eq + Hash, V>(&self, map: &mut HashMap<K, V>) -> Result<(), Full> {
        let before = map.capacity();
        if map.len() < before {
            return Ok(());
        }
        self.take(bytes_of_map::<K, V>(before + 1))?;
        if map.try_reserve(1).is_err() {
            return self.refuse(Full::System);
        }
        self.give(bytes_of_map::<K, V>(before));
        Ok(())
    }
}

#[cfg(feature = "json")]
impl Budget {
    /// Bytes that may be held beside the limit.
    pub(crate) fn allow(&self, bytes: u64) {
        self.free.set(self.free.get().saturating_add(bytes));
    }

    /// The last refusal.
    pub(crate) fn refused(&self) -> Option<Full> {
        self.refused.get()
    }

    /// Makes space in a list that gets no more than these.
    ///
    /// # Errors
    /// There is no memory for it.
    pub(crate) fn grow_exact<T>(&self, list: &mut Vec<T>, more: usize) -> Result<(), Full> {
        if list.capacity() - list.len() >= more {
            return Ok(());
        }
        self.resize(list, list.len().saturating_add(more))
    }

    /// A copy of a name.
    ///
    /// # Errors
    /// There is no memory for it.
    pub(crate) fn copied(&self, name: &str) -> Result<String, Full> {
        self.take(name.len() as u64)?;
        Ok(name.to_owned())
    }

    /// A table for so many entries.
    ///
    /// # Errors
    /// There is no memory for it.
    pub(crate) fn map<K: Eq + Hash, V>(&self, most: usize) -> Result<HashMap<K, V>, Full> {
        let mut map = HashMap::new();
        self.take(bytes_of_map::<K, V>(most))?;
        if map.try_reserve(most).is_err() {
            self.refuse(Full::System)?;
        }
        Ok(map)
    }
}

/// Bytes of a list with this capacity.
pub(crate) fn bytes_of<T>(capacity: usize) -> u64 {
    (capacity as u64).saturating_mul(size_of::<T>() as u64)
}

/// Most bytes of a table with room for so many entries: it has a power of two of places, of which at most seven in eight are used, with a byte each beside
/// the entry, and a group of such bytes more.
pub(crate) fn bytes_of_map<K, V>(most: usize) -> u64 {
    const GROUP: u64 = 64;
    if most == 0 {
        return 0;
    }
    let places = (most as u64).saturating_mul(8).div_ceil(7).max(8);
    let places = places.checked_next_power_of_two().unwrap_or(u64::MAX);
    places.saturating_mul(size_of::<(K, V)>() as u64 + 1).saturating_add(GROUP)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_count_by_their_capacity_and_twice_while_they_move() {
        let budget = Budget::new(8 * 4 + 8 * 8);
        let mut list: Vec<u64> = Vec::new();
        for number in 0..8 {
            budget.push(&mut list, number).unwrap();
        }
        assert_eq!((list.capacity(), budget.held.get()), (8, 64));
        let full = budget.push(&mut list, 8).unwrap_err();
        assert_eq!(full, Full::Limit { needed: 64 + 128, limit: 96 });
        // What was refused is not counted.
        assert_eq!((list.len(), budget.held.get()), (8, 64));
        budget.give(64);
        assert_eq!(budget.take(97), Err(Full::Limit { needed: 97, limit: 96 }));
        budget.take(96).unwrap();
    }

    #[test]
    fn sizes_past_all_numbers_are_refused() {
        let budget = Budget::unlimited();
        let mut list: Vec<u64> = vec![1];
        assert_eq!(budget.grow(&mut list, usize::MAX), Err(Full::System));
        assert!(Budget::new(u64::MAX - 1).take(u64::MAX).is_err());
        assert_eq!(bytes_of_map::<u64, u64>(usize::MAX), u64::MAX);
    }

    #[test]
    fn tables_count_at_least_what_they_have() {
        let budget = Budget::unlimited();
        let mut map: HashMap<u64, [u8; 3]> = HashMap::new();
        for number in 0..5000 {
            budget.grow_map(&mut map).unwrap();
            let capacity = map.capacity();
            map.insert(number, [0; 3]);
            assert_eq!(map.capacity(), capacity, "it grew by itself");
            let places = (capacity as u64 * 8).div_ceil(7);
            assert!(budget.held.get() >= places * 17 && budget.held.get() <= 4 * places * 17 + 256);
        }
    }
}
