//! The memory that the parts of a query hold in the host, and its limit.

use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use splitplane_core::error::{QueryError, check_bytes};

/// Bytes that all parts of a query hold.
#[derive(Debug)]
pub(super) struct Held {
    bytes: AtomicU64,
    max_memory: Option<u64>,
}

impl Held {
    /// At first the query holds `bytes` bytes.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] when that is more than allowed.
    pub(super) fn new(bytes: u64, max_memory: Option<u64>) -> Result<Held, QueryError> {
        check_bytes(bytes, max_memory)?;
        Ok(Held { bytes: AtomicU64::new(bytes), max_memory })
    }

    pub(super) fn max_memory(&self) -> Option<u64> {
        self.max_memory
    }

    /// Another part, which holds nothing so far.
    pub(super) fn share(&self) -> Share<'_> {
        Share { held: self, own: 0 }
    }
}

/// What a part of a query holds; nothing any more when it is dropped.
#[derive(Debug)]
pub(super) struct Share<'a> {
    held: &'a Held,
    own: u64,
}

impl Share<'_> {
    /// From now on the part holds `bytes` bytes.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] when all parts together hold more than allowed.
    pub(super) fn hold(&mut self, bytes: u64) -> Result<(), QueryError> {
        let difference = bytes.wrapping_sub(self.own);
        self.own = bytes;
        let all = self.held.bytes.fetch_add(difference, Relaxed).wrapping_add(difference);
        check_bytes(all, self.held.max_memory)
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        self.held.bytes.fetch_sub(self.own, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_no_more_than_allowed() {
        let held = Held::new(10, Some(30)).expect("within the limit");
        let (mut one, mut other) = (held.share(), held.share());
        assert_eq!((one.hold(12), other.hold(8)), (Ok(()), Ok(())));
        assert_eq!(one.hold(13), Err(QueryError::OutOfMemory { needed: 31, limit: 30 }));
        assert_eq!((one.hold(4), other.hold(16)), (Ok(()), Ok(())));
        drop(one);
        assert_eq!(other.hold(20), Ok(()));
        assert!(other.hold(21).is_err() && Held::new(31, Some(30)).is_err());
    }
}
