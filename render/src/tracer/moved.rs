//! Vertices that have moved.

use splitplane_core::mesh::Mesh;

/// A mesh whose vertices have moved since the last tree.
#[derive(Clone, Copy, Debug)]
pub struct Moved<'a> {
    /// The mesh as it is now.
    pub mesh: Mesh<'a>,
    /// The name of these positions, such as the number of the frame, where they come back: a GPU keeps them, up to
    /// 256 MiB of all names, and does not receive them again. `None` for positions that come once.
    pub name: Option<u64>,
}
