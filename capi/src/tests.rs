//! Tests of what C sees, called as C calls it.

mod answers;
mod float_state;
mod header;
mod misuse;
mod near;
mod own;
mod refused;
