//! Wavefront OBJ.
use super::Scene;
use std::path::Path;
use thiserror::Error;
/// Why.
#[derive(Debug, Error)]
#[error("x")]
pub struct ObjError;
/// Reads.
pub fn read(_: &Path) -> Result<Scene, ObjError> {
    Err(ObjError)
}
