//! A tree in device memory.

use splitplane_core::aabb::Aabb;
use splitplane_core::config::BuildConfig;
use splitplane_core::query::intersect::{Limits, SceneScale};
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::Triangle;

use super::pipelines::Queries;
use super::scene::SceneUniform;
use crate::device::gpu::Gpu;
use crate::device::halves::{binding_limit, half, halves_limit};
use crate::device::host;
use crate::device::scope::checked;
use crate::device::wait::{Wait, blocking};
use crate::error::GpuError;

/// The parts of a finished tree that are already on the device.
#[derive(Clone, Debug)]
pub struct TreeParts {
    /// [Nodes](splitplane_core::tree::node::KdNode) in preorder, 8 bytes each. Usages `STORAGE` and `COPY_SRC`.
    pub nodes: wgpu::Buffer,
    /// Triangle indices, named by leaves. Usages `STORAGE` and `COPY_SRC`.
    pub leaf_references: wgpu::Buffer,
    /// Snapped corners of all triangles of the mesh, dropped ones included: nine `f32` each. Usage
    /// `STORAGE`.
    pub triangles: wgpu::Buffer,
    /// How many nodes there are; never 0.
    pub node_count: u32,
    /// How many references there are.
    pub reference_count: u32,
    /// How many triangles there are.
    pub triangle_count: u32,
    /// Bounds of the triangles kept.
    pub bounds: Aabb,
    /// What shaped the tree.
    pub config: BuildConfig,
}

/// A tree in device memory, with what queries need in addition: 8 bytes per node, 4 per reference,
/// 36 per triangle, and 64 for the scene; and compressed nodes, where they are asked for.
///
/// A clone is the same tree in the same buffers: recycle one of them only when nobody uses another.
#[derive(Clone, Debug)]
pub struct DeviceTree {
    parts: TreeParts,
    scene: wgpu::Buffer,
    scale: SceneScale,
    compressed: Option<Compressed>,
}

/// The buffers of compressed nodes.
#[derive(Clone, Debug)]
pub(super) struct Compressed {
    pub(super) nodes: wgpu::Buffer,
    pub(super) references: wgpu::Buffer,
}

impl Compressed {
    fn bytes(&self) -> u64 {
        self.nodes.size() + self.references.size()
    }
}

impl DeviceTree {
    /// Takes over a tree that was made on the device. Reads all triangles once, on the device, for
    /// the range of their coordinates, and waits for that.
    ///
    /// The tree must be valid (see [`splitplane_core::tree::validate`]): a traversal trusts it.
    ///
    /// # Errors
    /// Buffers larger than a binding may be, or a device that fails.
    pub fn from_parts(queries: &Queries, parts: TreeParts) -> Result<DeviceTree, GpuError> {
        let limits = queries.triangle_limits(&parts.triangles, parts.triangle_count)?;
        DeviceTree::with_limits(queries, parts, &limits, None)
    }

    /// As [`DeviceTree::from_parts`], for triangles whose limits are known. `scene` is the uniform of a tree that
    /// is no longer needed.
    pub(crate) fn with_limits(
        queries: &Queries,
        parts: TreeParts,
        limits: &Limits,
        scene: Option<wgpu::Buffer>,
    ) -> Result<DeviceTree, GpuError> {
        let gpu = queries.gpu();
        let scale = SceneScale::new(parts.bounds, limits);
        let uniform = SceneUniform::from(&scale);
        let scene = checked(gpu, "the scene's uniform", || {
            let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
            let scene = match scene {
                Some(scene) => scene,
                None => gpu.buffer("scene", size_of::<SceneUniform>() as u64, usage)?,
            };
            gpu.write(&scene, 0, bytemuck::bytes_of(&uniform));
            Ok(scene)
        })?;
        for (what, buffer) in [
            ("the nodes of the tree", &parts.nodes),
            ("the references of the tree", &parts.leaf_references),
        ] {
            can_be_bound(gpu, what, buffer.size())?;
        }
        fits_in_halves(gpu, "the triangles", parts.triangles.size())?;
        Ok(DeviceTree { parts, scene, scale, compressed: None })
    }

    /// Uploads a tree built elsewhere. `triangles` are the snapped corners of the mesh (see
    /// [`splitplane_core::triangle::prepare`]), dropped triangles included. The tree must be valid
    /// and belong to them (see [`splitplane_core::tree::validate::validate_mesh`]).
    ///
    /// # Errors
    /// More triangles, nodes or references than the device can bind or hold, or a device that fails.
    ///
    /// # Panics
    /// If the number of triangles is not the tree's.
    pub fn upload(
        queries: &Queries,
        tree: &KdTreeView<'_>,
        triangles: &[Triangle],
    ) -> Result<DeviceTree, GpuError> {
        assert_eq!(triangles.len(), tree.triangles as usize, "triangles of another mesh");
        let gpu = queries.gpu();
        let filled = |what: &str, bytes: &[u8]| {
            use wgpu::BufferUsages as Usage;
            let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
            let buffer = gpu.long_buffer(what, bytes.len() as u64, usage)?;
            gpu.write(&buffer, 0, bytes);
            Ok(buffer)
        };
        can_be_bound(gpu, "the nodes of the tree", size_of_val(tree.nodes) as u64)?;
        can_be_bound(gpu, "the references of the tree", size_of_val(tree.references) as u64)?;
        fits_in_halves(gpu, "the triangles", size_of_val(triangles) as u64)?;
        let parts = checked(gpu, "the upload of a tree", || {
            Ok(TreeParts {
                nodes: filled("the nodes of the tree", bytemuck::cast_slice(tree.nodes))?,
                leaf_references: filled(
                    "the references of the tree",
                    bytemuck::cast_slice(tree.references),
                )?,
                triangles: filled("the triangles", bytemuck::cast_slice(triangles))?,
                node_count: tree.nodes.len() as u32,
                reference_count: tree.references.len() as u32,
                triangle_count: tree.triangles,
                bounds: tree.bounds,
                config: tree.config,
            })
        })?;
        DeviceTree::from_parts(queries, parts)
    }

    /// The compressed nodes, where [`DeviceTree::compress`] has made some.
    pub(super) fn compressed(&self) -> Option<&Compressed> {
        self.compressed.as_ref()
    }

    pub(super) fn set_compressed(&mut self, compressed: Compressed) {
        self.compressed = Some(compressed);
    }

    /// The buffers of the compressed nodes, where there are some: the nodes, 80 bytes each, and the references of their leaves.
    pub fn compressed_buffers(&self) -> Option<[&wgpu::Buffer; 2]> {
        self.compressed.as_ref().map(|held| [&held.nodes, &held.references])
    }

    /// Whether it has compressed nodes.
    pub fn is_compressed(&self) -> bool {
        self.compressed.is_some()
    }

    /// The buffers, for further use.
    pub fn into_parts(self) -> TreeParts {
        self.parts
    }

    /// All buffers: the parts, and the uniform of the scene.
    pub(crate) fn into_buffers(self) -> (TreeParts, wgpu::Buffer) {
        (self.parts, self.scene)
    }

    /// The tree, read back to host memory. Waits for the device.
    ///
    /// # Errors
    /// A device that fails.
    pub fn read(&self, gpu: &Gpu) -> Result<KdTree, GpuError> {
        blocking(self.read_by(Wait::Blocking, gpu))
    }

    /// As [`DeviceTree::read`], without blocking.
    ///
    /// # Errors
    /// As for [`DeviceTree::read`].
    pub async fn read_async(&self, gpu: &Gpu) -> Result<KdTree, GpuError> {
        match self.read_by(Wait::Yielding, gpu).await {
            Err(error) => Err(gpu.cause(error).await),
            read => read,
        }
    }

    /// As [`DeviceTree::read`], waiting in either way.
    #[doc(hidden)]
    pub async fn read_by(&self, wait: Wait, gpu: &Gpu) -> Result<KdTree, GpuError> {
        let parts = &self.parts;
        let bytes = 8 * u64::from(parts.node_count);
        let nodes = read_buffer(wait, gpu, &parts.nodes, bytes).await?;
        let bytes = 4 * u64::from(parts.reference_count);
        let references = read_buffer(wait, gpu, &parts.leaf_references, bytes).await?;
        Ok(KdTree {
            nodes: host::copied(&nodes)?,
            references: host::copied(&references)?,
            bounds: parts.bounds,
            triangles: parts.triangle_count,
            config: parts.config,
        })
    }

    /// Whether each buffer of the tree fits one binding, as [`DeviceTree::bind_group_entries`] needs it.
    /// Batches and frames do not: their kernels have two bindings for triangles that are too many for one.
    ///
    /// # Errors
    /// The limit that the triangles exceed: more than 3.7 million of them under WebGPU's default limits.
    pub fn check_one_binding(&self, gpu: &Gpu) -> Result<(), GpuError> {
        can_be_bound(gpu, "the triangles, in one binding", self.parts.triangles.size())
    }

    /// The triangles as two bindings hold them, where one does not.
    pub fn triangle_halves(&self, gpu: &Gpu) -> Option<[wgpu::BufferBinding<'_>; 2]> {
        let triangles = &self.parts.triangles;
        let bytes = triangles.size();
        let is_long = bytes > binding_limit(gpu.limits()).0;
        is_long.then(|| [false, true].map(|second| half(triangles, bytes, second, 0)))
    }

    /// The resources for the four bindings of a traversal from `first_binding` on: nodes, leaf
    /// references, triangles, scene. For a host's own shader; see
    /// [`splitplane_shaders::traversal`]. wgpu refuses a tree for which [`DeviceTree::check_one_binding`] is
    /// an error.
    pub fn bind_group_entries(&self, first_binding: u32) -> [wgpu::BindGroupEntry<'_>; 4] {
        let parts = &self.parts;
        let buffers = [&parts.nodes, &parts.leaf_references, &parts.triangles, &self.scene];
        std::array::from_fn(|place| wgpu::BindGroupEntry {
            binding: first_binding + place as u32,
            resource: buffers[place].as_entire_binding(),
        })
    }

    /// The layout of the same four bindings, for hosts that state their layouts.
    pub fn bind_group_layout_entries(
        first_binding: u32,
        visibility: wgpu::ShaderStages,
    ) -> [wgpu::BindGroupLayoutEntry; 4] {
        std::array::from_fn(|place| wgpu::BindGroupLayoutEntry {
            binding: first_binding + place as u32,
            visibility,
            ty: wgpu::BindingType::Buffer {
                ty: if place < 3 {
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

    /// The nodes: [`KdNode`](splitplane_core::tree::node::KdNode), 8 bytes each.
    pub fn nodes(&self) -> &wgpu::Buffer {
        &self.parts.nodes
    }

    /// The references of the leaves: `u32` each.
    pub fn leaf_references(&self) -> &wgpu::Buffer {
        &self.parts.leaf_references
    }

    /// The snapped corners: nine `f32` per triangle.
    pub fn triangles(&self) -> &wgpu::Buffer {
        &self.parts.triangles
    }

    /// The uniform of the scene, a [`SceneUniform`].
    pub fn scene(&self) -> &wgpu::Buffer {
        &self.scene
    }

    /// How many nodes there are.
    pub fn node_count(&self) -> u32 {
        self.parts.node_count
    }

    /// How many references there are.
    pub fn reference_count(&self) -> u32 {
        self.parts.reference_count
    }

    /// How many triangles the mesh has, dropped ones included.
    pub fn triangle_count(&self) -> u32 {
        self.parts.triangle_count
    }

    /// Bounds of the triangles kept.
    pub fn bounds(&self) -> &Aabb {
        &self.parts.bounds
    }

    /// What shaped the tree.
    pub fn config(&self) -> &BuildConfig {
        &self.parts.config
    }

    /// What the reference traversal needs for the same answers.
    pub fn scene_scale(&self) -> &SceneScale {
        &self.scale
    }

    /// Bytes of device memory.
    pub fn bytes(&self) -> u64 {
        let parts = &self.parts;
        [&parts.nodes, &parts.leaf_references, &parts.triangles, &self.scene]
            .map(wgpu::Buffer::size)
            .iter()
            .sum::<u64>()
            + self.compressed.as_ref().map_or(0, Compressed::bytes)
    }
}

/// Whether this many bytes fit one binding.
pub(super) fn can_be_bound(gpu: &Gpu, what: &str, needed: u64) -> Result<(), GpuError> {
    let allowed = gpu.device().limits().max_storage_buffer_binding_size;
    if needed > allowed {
        let limit = "max_storage_buffer_binding_size";
        return Err(GpuError::Limit { what: what.to_string(), limit, needed, allowed });
    }
    Ok(())
}

/// Whether two bindings hold a buffer of this size.
fn fits_in_halves(gpu: &Gpu, what: &str, needed: u64) -> Result<(), GpuError> {
    let (allowed, limit) = halves_limit(gpu.limits());
    if needed > allowed {
        return Err(GpuError::Limit { what: what.to_string(), limit, needed, allowed });
    }
    Ok(())
}

/// The first bytes of a buffer with the usage `COPY_SRC`.
async fn read_buffer(
    wait: Wait,
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    bytes: u64,
) -> Result<Vec<u8>, GpuError> {
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let from = gpu.mark();
    let readback = checked(gpu, "reading a tree back", || {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let readback = gpu.buffer("tree, read back", bytes, usage)?;
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &readback, 0, bytes);
        gpu.submit([encoder.finish()])?;
        Ok(readback)
    })?;
    gpu.read_mapped_by(wait, from, &readback, bytes).await
}
