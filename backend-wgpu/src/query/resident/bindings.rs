//! A scene on a device for a host's own shader.

use super::held::HeldScene;
use crate::device::gpu::Gpu;
use crate::device::scope::checked;
use crate::error::GpuError;

/// Bindings of a scene's traversal.
const BINDINGS: usize = splitplane_shaders::SCENE_BINDING_COUNT as usize;

/// What a host's own shader binds to trace rays through a scene: the buffers that [`splitplane_shaders::scene_traversal`] declares.
///
/// They are those of the scene as it was when they were asked for, by
/// [`WgpuScene::bindings`](super::WgpuScene::bindings). An update of the scene writes some of them and makes others anew, so after one ask again.
///
/// In the order of the bindings:
///
/// | | what | bytes each |
/// |---|---|---|
/// | 0 | nodes of the tree over instances, [`PackedTopNode`](splitplane_core::backend::scene::packed::PackedTopNode) | 256 |
/// | 1 | instances by their names, [`PackedInstance`](splitplane_core::backend::scene::packed::PackedInstance) | 128 |
/// | 2 | nodes of all geometries, [`KdNode`](splitplane_core::tree::node::KdNode) | 8 |
/// | 3 | references of all geometries, and words of opacity masks | 4 |
/// | 4 | snapped corners of all triangles, nine `f32` | 36 |
/// | 5 | blocks of spheres and capsules | 256 |
/// | 6 | a uniform: the number of nodes of the tree over instances, and zeros | 16 |
///
/// The first six are the arrays of a [`PackedScene`](splitplane_core::backend::scene::packed::PackedScene).
#[derive(Clone, Debug)]
pub struct SceneBindings {
    buffers: [wgpu::Buffer; BINDINGS],
}

impl SceneBindings {
    /// Those of a scene that a device holds. Makes the uniform.
    pub(super) fn new(gpu: &Gpu, held: &HeldScene) -> Result<SceneBindings, GpuError> {
        let facts = [held.top_nodes() as u32, 0, 0, 0];
        let uniform = checked(gpu, "what a host's shader knows of a scene", || {
            let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
            let uniform = gpu.buffer("facts of a scene", size_of_val(&facts) as u64, usage)?;
            gpu.write(&uniform, 0, bytemuck::bytes_of(&facts));
            Ok(uniform)
        })?;
        let [box_nodes, instances, nodes, references, triangles, shapes] = held.buffers.clone();
        let buffers = [box_nodes, instances, nodes, references, triangles, shapes, uniform];
        Ok(SceneBindings { buffers })
    }

    /// The buffers, in the order of the bindings. The last is a uniform, the others storage.
    pub fn buffers(&self) -> &[wgpu::Buffer; BINDINGS] {
        &self.buffers
    }

    /// The resources for the bindings of the traversal from `first_binding` on.
    pub fn bind_group_entries(&self, first_binding: u32) -> [wgpu::BindGroupEntry<'_>; BINDINGS] {
        std::array::from_fn(|place| wgpu::BindGroupEntry {
            binding: first_binding + place as u32,
            resource: self.buffers[place].as_entire_binding(),
        })
    }

    /// The layout of the same bindings, for hosts that state their layouts.
    pub fn bind_group_layout_entries(
        first_binding: u32,
        visibility: wgpu::ShaderStages,
    ) -> [wgpu::BindGroupLayoutEntry; BINDINGS] {
        std::array::from_fn(|place| wgpu::BindGroupLayoutEntry {
            binding: first_binding + place as u32,
            visibility,
            ty: wgpu::BindingType::Buffer {
                ty: if place + 1 < BINDINGS {
                    wgpu::BufferBindingType::Storage { read_only: true }
                } else {
                    wgpu::BufferBindingType::Uniform
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
    }
}
