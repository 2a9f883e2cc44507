//! Rules of the source code, one module a file, in one program.

mod circles;
mod node_codec;
mod programs;
