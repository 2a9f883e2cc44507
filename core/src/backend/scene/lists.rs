//! Lists that grow, or an error where there is no memory.

use alloc::vec::Vec;

use crate::scene::SceneBuildError;

pub(super) fn lacking(bytes: u64) -> SceneBuildError {
    SceneBuildError::OutOfMemory { needed: bytes, limit: bytes }
}

pub(super) fn reserve<T>(list: &mut Vec<T>, more: usize) -> Result<(), SceneBuildError> {
    let bytes = more.saturating_mul(size_of::<T>()) as u64;
    list.try_reserve(more).map_err(|_| lacking(bytes))
}

pub(super) fn push<T>(list: &mut Vec<T>, one: T) -> Result<(), SceneBuildError> {
    reserve(list, 1)?;
    list.push(one);
    Ok(())
}
