//! Tests of the shaders' texts, one module a file, in one program.

mod abi;
mod lint;
#[path = "support/source.rs"]
mod source;
mod translated;
