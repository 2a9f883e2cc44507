//! A mesh on the device whose vertices transforms move there.

use std::sync::Arc;

use splitplane_core::kernel::{QueryBuffer, QueryKernel, QueryUniform, RayQueries, Slot};
use splitplane_core::layout::VertexCount;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::Transform;
use splitplane_core::scene::moved::{MoveError, check_rest, check_transforms, snapped};
use thiserror::Error;
use wgpu::BufferUsages as Usage;

use super::shared::Shared;
use super::source::DeviceMesh;
use crate::device::kernel_set::Bound;
use crate::device::once;
use crate::device::scope::checked;
use crate::error::GpuError;
use crate::query::QueryVariant;

/// Why a mesh cannot be moved on a device.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MovedMeshError {
    /// The mesh, its groups or the transforms do not fit one another.
    #[error(transparent)]
    Move(#[from] MoveError),
    /// The device fails, or cannot hold the mesh.
    #[error(transparent)]
    Device(#[from] GpuError),
}

/// A mesh whose vertices stand on the device at rest, each in a group. A kernel moves every group by a transform, so that of a new
/// pose nothing is sent but 48 bytes a group. The positions have the bits of [`splitplane_core::scene::moved::move_vertices`].
#[derive(Debug)]
pub struct MovedMesh {
    shared: Arc<Shared>,
    vertices: u32,
    triangles: u32,
    /// How many transforms there are.
    groups: usize,
    /// The greatest magnitude of a coordinate at rest.
    greatest: f32,
    rest: wgpu::Buffer,
    group_of: wgpu::Buffer,
    transforms: wgpu::Buffer,
    count: wgpu::Buffer,
    positions: wgpu::Buffer,
    indices: Option<wgpu::Buffer>,
}

impl MovedMesh {
    /// Sends a mesh to the device. `group_of` has a number below `groups` for each vertex.
    pub(crate) fn new(
        shared: &Arc<Shared>,
        mesh: &Mesh<'_>,
        group_of: &[u32],
        groups: usize,
    ) -> Result<MovedMesh, MovedMeshError> {
        let (rest, indices) = mesh.arrays();
        let greatest = check_rest(rest, group_of, groups)?;
        let gpu = &shared.gpu;
        let filled = |what: &str, bytes: &[u8], usage: Usage| -> Result<_, GpuError> {
            let buffer = gpu.buffer(what, bytes.len() as u64, usage | Usage::COPY_DST)?;
            gpu.write(&buffer, 0, bytes);
            Ok(buffer)
        };
        let bytes = size_of_val(rest) as u64;
        let count = VertexCount { count: rest.len() as u32, zero: 0 };
        Ok(checked(gpu, "a mesh that moves", || {
            let made = MovedMesh {
                shared: Arc::clone(shared),
                vertices: count.count,
                triangles: mesh.len() as u32,
                groups,
                greatest,
                rest: filled("positions at rest", bytemuck::cast_slice(rest), Usage::STORAGE)?,
                group_of: filled("groups", bytemuck::cast_slice(group_of), Usage::STORAGE)?,
                transforms: {
                    let usage = Usage::STORAGE | Usage::COPY_DST;
                    gpu.buffer("transforms", 48 * groups as u64, usage)?
                },
                count: filled("vertex count", bytemuck::bytes_of(&count), Usage::UNIFORM)?,
                positions: gpu.buffer("moved", bytes, Usage::STORAGE | Usage::COPY_SRC)?,
                indices: match indices {
                    Some(indices) => {
                        let bytes = bytemuck::cast_slice(indices);
                        Some(filled("indices", bytes, Usage::COPY_SRC)?)
                    }
                    None => None,
                },
            };
            Ok(made)
        })?)
    }

    /// Moves each group by its transform, and gives the mesh, for the next build that is submitted
    /// ([`WgpuBackend::submit_build_from`](crate::WgpuBackend::submit_build_from)). Waits for nothing.
    ///
    /// # Errors
    /// Another number of transforms than of groups, one that is not finite or moves vertices too far, a device that fails. The
    /// vertices stand where they stood.
    pub fn place(&mut self, transforms: &[Transform]) -> Result<DeviceMesh<'_>, MovedMeshError> {
        if transforms.len() != self.groups {
            let (found, groups) = (transforms.len(), self.groups);
            return Err(MoveError::Transforms { found, groups }.into());
        }
        check_transforms(transforms, self.greatest)?;
        if self.vertices > 0 {
            let gpu = &self.shared.gpu;
            let rows: Vec<Transform> = transforms.iter().map(snapped).collect();
            checked(gpu, "moving vertices", || {
                gpu.write(&self.transforms, 0, bytemuck::cast_slice(&rows));
                let mut encoder = gpu.device().create_command_encoder(&Default::default());
                self.record(&mut encoder)?;
                gpu.submit([encoder.finish()]).map(|_| ())
            })?;
        }
        Ok(DeviceMesh {
            positions: &self.positions,
            vertices: self.vertices,
            indices: self.indices.as_ref(),
            triangles: self.triangles,
        })
    }

    fn record(&self, encoder: &mut wgpu::CommandEncoder) -> Result<(), GpuError> {
        let find = |bound: &Bound<RayQueries>| {
            let held = match bound.slot {
                Slot::Uniform(QueryUniform::VertexCount) => &self.count,
                Slot::Uniform(_) => return None,
                Slot::Storage(binding) => match binding.buffer {
                    QueryBuffer::RestPositions => &self.rest,
                    QueryBuffer::VertexGroups => &self.group_of,
                    QueryBuffer::Transforms => &self.transforms,
                    QueryBuffer::Positions => &self.positions,
                    _ => return None,
                },
            };
            Some(held.as_entire_buffer_binding())
        };
        let Shared { gpu, pipelines, .. } = &*self.shared;
        let kernel = (QueryKernel::MoveVertices, &QueryVariant::default());
        once::record(gpu, pipelines, encoder, kernel, self.vertices, find)
    }

    /// Bytes of device memory.
    pub fn bytes(&self) -> u64 {
        let held = [&self.rest, &self.group_of, &self.transforms, &self.count, &self.positions];
        held.into_iter().chain(&self.indices).map(wgpu::Buffer::size).sum()
    }

    /// Gives the kernel another text, or its own again: for tests that plant faults.
    #[doc(hidden)]
    pub fn replace_kernel(&self, source: Option<String>) {
        self.shared.pipelines.replace::<RayQueries>(QueryKernel::MoveVertices, source);
    }
}
