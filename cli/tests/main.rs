//! Tests of the program, one module a file, in one program.

mod bad_files;
mod cli;
mod common;
mod environment;
mod mesh_files;
mod paper;
mod parts;
mod pictures;
mod points;
mod scene_files;
mod shell;
mod tracer;
mod trade;
mod written_files;
