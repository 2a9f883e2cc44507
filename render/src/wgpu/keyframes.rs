//! The vertices of a scene that moves, kept on the device from the first time that they are shown.

use splitplane_core::mesh::Mesh;
use splitplane_core::tree::digest::Xxh64;
use splitplane_wgpu::{DeviceMesh, Gpu, GpuError};
use std::collections::HashMap;
use wgpu::BufferUsages as Usage;

/// Most bytes of keyframes that are kept: 21 million vertices. Positions beyond them are sent each time.
pub const KEYFRAME_BYTES: u64 = 256 << 20;

/// Indices and positions on the device. What is there already is not sent again: a frame that comes back costs
/// nothing, and one that is new only its positions.
#[derive(Debug, Default)]
pub struct Keyframes {
    /// The indices on the device, and the same on the host, to tell whether they have changed.
    indices: Option<(Vec<[u32; 3]>, wgpu::Buffer)>,
    kept: HashMap<u64, Kept>,
    bytes: u64,
    /// For positions that are not kept.
    passing: Option<wgpu::Buffer>,
    most: Option<u64>,
}

/// The positions of one frame.
#[derive(Debug)]
struct Kept {
    positions: wgpu::Buffer,
    vertices: usize,
    /// Of their bytes: a file may have changed between two rounds.
    digest: u64,
}

impl Keyframes {
    /// Limits the bytes that are kept, instead of [`KEYFRAME_BYTES`].
    pub fn limit(&mut self, bytes: u64) {
        self.most = Some(bytes);
        self.forget();
    }

    /// Lets all positions go: names mean other frames from now on.
    pub fn forget(&mut self) {
        self.kept.clear();
        self.bytes = 0;
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        let indices = self.indices.as_ref().map_or(0, |(_, buffer)| buffer.size());
        self.bytes + indices + self.passing.as_ref().map_or(0, wgpu::Buffer::size)
    }

    /// The mesh on the device, for the next build that is submitted. `name` is that of its positions, if they are
    /// to be kept.
    ///
    /// # Errors
    /// The device's.
    pub fn place(
        &mut self,
        gpu: &Gpu,
        mesh: &Mesh<'_>,
        name: Option<u64>,
    ) -> Result<DeviceMesh<'_>, GpuError> {
        let (positions, indices) = mesh.arrays();
        self.place_indices(gpu, indices)?;
        let bytes: &[u8] = bytemuck::cast_slice(positions);
        let kept = match name {
            Some(name) => self.keep(gpu, name, bytes)?,
            None => false,
        };
        if !kept {
            let needed = bytes.len() as u64;
            if self.passing.as_ref().is_none_or(|held| held.size() < needed) {
                // The old one goes first: both may not fit.
                self.passing = None;
                self.passing = Some(gpu.buffer("positions", needed, USAGE)?);
            }
        }
        let held = match name.filter(|_| kept).and_then(|name| self.kept.get(&name)) {
            Some(kept) => Some(&kept.positions),
            None => {
                let passing = self.passing.as_ref();
                if let Some(buffer) = passing {
                    // The build before has been submitted with its copy: the queue keeps the order.
                    gpu.guard(|| gpu.write(buffer, 0, bytes))?;
                }
                passing
            }
        };
        let missing = || GpuError::Refused("there is no buffer of positions".into());
        Ok(DeviceMesh {
            positions: held.ok_or_else(missing)?,
            vertices: positions.len() as u32,
            indices: indices.and(self.indices.as_ref()).map(|(_, buffer)| buffer),
            triangles: mesh.len() as u32,
        })
    }

    /// Sends indices that are not those on the device.
    fn place_indices(&mut self, gpu: &Gpu, wanted: Option<&[[u32; 3]]>) -> Result<(), GpuError> {
        let Some(wanted) = wanted else { return Ok(()) };
        let bytes: &[u8] = bytemuck::cast_slice(wanted);
        match self.indices.take() {
            Some((same, buffer)) if same == wanted => self.indices = Some((same, buffer)),
            old => {
                let needed = bytes.len() as u64;
                let fits = old.filter(|(_, buffer)| buffer.size() >= needed);
                let (mut held, buffer) = match fits {
                    Some(fits) => fits,
                    None => (Vec::new(), gpu.buffer("indices", needed, USAGE)?),
                };
                gpu.guard(|| gpu.write(&buffer, 0, bytes))?;
                held.clear();
                held.extend_from_slice(wanted);
                self.indices = Some((held, buffer));
            }
        }
        Ok(())
    }

    /// Whether the positions of this name are on the device, sent now or before.
    fn keep(&mut self, gpu: &Gpu, name: u64, bytes: &[u8]) -> Result<bool, GpuError> {
        let mut digest = Xxh64::new(0);
        digest.write(bytes);
        let (digest, vertices) = (digest.finish(), bytes.len() / VERTEX);
        if let Some(kept) = self.kept.get_mut(&name)
            && kept.vertices == vertices
        {
            if kept.digest != digest {
                gpu.guard(|| gpu.write(&kept.positions, 0, bytes))?;
                kept.digest = digest;
            }
            return Ok(true);
        }
        if let Some(old) = self.kept.remove(&name) {
            self.bytes -= old.positions.size();
        }
        let room = self.most.unwrap_or(KEYFRAME_BYTES).saturating_sub(self.bytes);
        if bytes.len() as u64 > room {
            return Ok(false);
        }
        let positions = match gpu.buffer("keyframe", bytes.len() as u64, USAGE) {
            Ok(buffer) => buffer,
            Err(GpuError::OutOfMemory { .. }) => {
                // Builds need it more.
                self.forget();
                self.most = Some(0);
                return Ok(false);
            }
            Err(error) => return Err(error),
        };
        gpu.guard(|| gpu.write(&positions, 0, bytes))?;
        self.bytes += positions.size();
        self.kept.insert(name, Kept { positions, vertices, digest });
        Ok(true)
    }
}

const USAGE: Usage = Usage::COPY_SRC.union(Usage::COPY_DST);
/// Bytes of a vertex.
const VERTEX: usize = 12;
