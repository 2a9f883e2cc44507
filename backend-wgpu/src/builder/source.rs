//! Where a build finds its triangles: in host memory, or on the device already.

use splitplane_core::mesh::{MAX_TRIANGLES, Mesh, MeshError};

/// A mesh in buffers of the device, for engines that move vertices there. The buffers are copied when
/// the build is submitted, in the order of the queue, and may change afterwards.
#[derive(Clone, Copy, Debug)]
pub struct DeviceMesh<'a> {
    /// Positions, three `f32` each without padding, from the start of the buffer. Usage `COPY_SRC`.
    pub positions: &'a wgpu::Buffer,
    /// How many positions there are.
    pub vertices: u32,
    /// Three `u32` per triangle, from the start of the buffer, usage `COPY_SRC`; `None` for a soup,
    /// in which every three positions are a triangle. A triangle that names a position beyond the
    /// last is dropped, and counted.
    pub indices: Option<&'a wgpu::Buffer>,
    /// How many triangles there are.
    pub triangles: u32,
}

/// A mesh in host or device memory.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source<'a> {
    Host(Mesh<'a>),
    Device(DeviceMesh<'a>),
}

impl Source<'_> {
    pub(crate) fn triangles(&self) -> u32 {
        match self {
            Source::Host(mesh) => mesh.len() as u32,
            Source::Device(mesh) => mesh.triangles,
        }
    }

    /// Bytes of positions and of indices.
    pub(crate) fn bytes(&self) -> [u64; 2] {
        match self {
            Source::Host(mesh) => {
                let (positions, indices) = mesh.arrays();
                let indices = indices.map_or(0, size_of_val);
                [size_of_val(positions) as u64, indices as u64]
            }
            Source::Device(mesh) => {
                let indices = mesh.indices.map_or(0, |_| 12 * u64::from(mesh.triangles));
                [12 * u64::from(mesh.vertices), indices]
            }
        }
    }

    /// The word where indices begin, after the positions; `u32::MAX` for a soup.
    pub(crate) fn first_index(&self) -> u32 {
        let indexed = match self {
            Source::Host(mesh) => mesh.arrays().1.is_some(),
            Source::Device(mesh) => mesh.indices.is_some(),
        };
        if indexed { (self.bytes()[0] / 4) as u32 } else { u32::MAX }
    }
}

impl DeviceMesh<'_> {
    /// Whether the counts fit the buffers and one another.
    pub(crate) fn check(&self) -> Result<(), String> {
        if self.triangles as usize > MAX_TRIANGLES {
            let error = MeshError::TooManyTriangles { triangles: self.triangles as usize };
            return Err(error.to_string());
        }
        let held = |what: &str, buffer: &wgpu::Buffer, needed: u64| {
            if buffer.size() < needed {
                return Err(format!(
                    "the buffer of {what} has {} bytes, but {needed} are needed",
                    buffer.size()
                ));
            }
            match buffer.usage().contains(wgpu::BufferUsages::COPY_SRC) {
                true => Ok(()),
                false => Err(format!("the buffer of {what} lacks the usage COPY_SRC")),
            }
        };
        held("positions", self.positions, 12 * u64::from(self.vertices))?;
        match self.indices {
            Some(indices) => held("indices", indices, 12 * u64::from(self.triangles)),
            None if u64::from(self.vertices) < 3 * u64::from(self.triangles) => Err(format!(
                "{} triangles of a soup need {} positions, but there are {}",
                self.triangles,
                3 * u64::from(self.triangles),
                self.vertices
            )),
            None => Ok(()),
        }
    }
}
