//! Tests of what fuzz targets do, one module a file, in one program.

mod common;
mod corpus;
mod scene_operations;
