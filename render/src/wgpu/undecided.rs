//! Rays of an exact frame that its device left undecided: the CPU traces them again between waves.

use super::buffers::Buffers;
use crate::error::RenderError;
use crate::frame::FrameInput;
use crate::kernel::{
    Buffer, DEFERRED_HEAD, DEFERRED_WORDS, Kernel, UNDECIDED_PATHS, UNDECIDED_SHADOW_RAYS,
    UNDECIDED_WORDS,
};
use crate::layout::Frame;
use crate::plan::Plan;
use crate::scene_words::SceneWords;
use crate::surface::{MOST_CLEAR_LAYERS, after};
use crate::vector::{greatest, mul};
use rayon::prelude::*;
use splitplane_core::error::{DeviceError, QueryError};
use splitplane_core::exact::{ExactRay, meet};
use splitplane_core::query::traverse::{Query, Triangles, exact};
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::tree::KdTree;
use splitplane_float_state::standard;
use splitplane_wgpu::device::Wait;
use splitplane_wgpu::device::readback::read_by;
use splitplane_wgpu::{DeviceTree, Gpu};
use wgpu::BufferUsages as Usage;

/// Bytes of an answer: a hit, or what is left of the light of a shadow ray.
const ANSWER: usize = 16;

/// What the CPU needs to trace rays again.
#[derive(Debug)]
pub(super) struct Undecided<'a> {
    gpu: &'a Gpu,
    tree: &'a DeviceTree,
    input: FrameInput<'a>,
    frame: Frame,
    /// The tree, read back when a ray first needs it.
    copy: Option<KdTree>,
    redone: u64,
}

/// A ray, as the device leaves it.
struct Left {
    index: u32,
    /// What it certainly meets first, where only the last bits are undecided.
    triangle: u32,
    ray: Ray,
    light: [f32; 3],
}

impl Left {
    fn of_words(words: &[u32]) -> Left {
        let float = |at: usize| f32::from_bits(words[at]);
        let vector = |at: usize| [float(at), float(at + 1), float(at + 2)];
        let ray = Ray { origin: vector(2), t_min: float(5), direction: vector(6), t_max: float(9) };
        Left { index: words[0], triangle: words[1], ray, light: vector(10) }
    }
}

/// Where a kernel counts the rays that it leaves, in words, and where their answers go; `None` for one that leaves none.
fn left_by(kernel: Kernel) -> Option<(u32, Buffer)> {
    match kernel {
        Kernel::ClosestHits => Some((UNDECIDED_PATHS, Buffer::Hits)),
        Kernel::ShadowHits | Kernel::ShadowHitsThroughGlass => {
            Some((UNDECIDED_SHADOW_RAYS, Buffer::ShadowLight))
        }
        _ => None,
    }
}

/// Whether a kernel leaves rays to the CPU.
pub(super) fn leaves(kernel: Kernel) -> bool {
    left_by(kernel).is_some()
}

impl<'a> Undecided<'a> {
    pub(super) fn new(
        gpu: &'a Gpu,
        tree: &'a DeviceTree,
        input: FrameInput<'a>,
        frame: Frame,
    ) -> Undecided<'a> {
        Undecided { gpu, tree, input, frame, copy: None, redone: 0 }
    }

    /// Rays that were traced again so far.
    pub(super) fn redone(&self) -> u64 {
        self.redone
    }

    /// Answers what a kernel has left. Reads 16 bytes, and 52 a ray where there are any.
    pub(super) async fn finish(
        &mut self,
        wait: Wait,
        kernel: Kernel,
        buffers: &Buffers,
        plan: &Plan,
    ) -> Result<(), RenderError> {
        let (Some((word, answered)), Some(list)) = (left_by(kernel), buffers.get(Buffer::Deferred))
        else {
            return Ok(());
        };
        let head = words(&read_by(wait, self.gpu, list, 0, 4 * u64::from(DEFERRED_HEAD)).await?);
        // No more than there is room for, whatever a device says.
        let room = plan.path_room().max(plan.shadow_room());
        let count = head[word as usize].min(room);
        let Some(answered) = buffers.get(answered).filter(|_| count > 0) else { return Ok(()) };
        let at = 4 * u64::from(DEFERRED_HEAD + DEFERRED_WORDS * room);
        let bytes = 4 * u64::from(count * UNDECIDED_WORDS);
        let records = words(&read_by(wait, self.gpu, list, at, bytes).await?);
        let mut left: Vec<Left> =
            records.chunks_exact(UNDECIDED_WORDS as usize).map(Left::of_words).collect();
        if let Some(beyond) = left.iter().find(|left| left.index >= room) {
            let reason = format!(
                "it left ray {} undecided, where a kernel has {room} at most",
                beyond.index
            );
            return Err(QueryError::from(DeviceError::Failed(reason)).into());
        }
        // Neighbours go back together.
        left.sort_unstable_by_key(|left| left.index);
        if self.copy.is_none() && !left.iter().all(|left| self.at_triangle(left).is_some()) {
            self.copy = Some(self.tree.read_by(wait, self.gpu).await?);
        }
        let answers: Vec<[u8; ANSWER]> = match kernel {
            Kernel::ClosestHits => self.answers(&left, |left| {
                bytemuck::cast(self.at_triangle(left).unwrap_or_else(|| self.closest(&left.ray)))
            }),
            Kernel::ShadowHits => self.answers(&left, |left| {
                let [r, g, b] = left.light;
                let is_dark = self.trace(&left.ray, Query::Any).is_hit();
                bytemuck::cast(if is_dark { [0.0; 4] } else { [r, g, b, 0.0] })
            }),
            _ => self.answers(&left, |left| bytemuck::cast(self.through_glass(left))),
        };
        self.redone += u64::from(count);
        self.send(&left, &answers, answered)
    }

    fn answers(
        &self,
        left: &[Left],
        answer: impl Fn(&Left) -> [u8; ANSWER] + Sync + Send,
    ) -> Vec<[u8; ANSWER]> {
        left.par_iter().map(|left| standard(|| answer(left))).collect()
    }

    /// The hit at the triangle that the device named. `None` where it named none, or a wrong one.
    fn at_triangle(&self, left: &Left) -> Option<Hit> {
        if left.triangle as usize >= self.input.mesh.len() {
            return None;
        }
        let corners = self.input.mesh.corners(left.triangle);
        let met = meet(&ExactRay::new(&left.ray)?, &corners, self.input.query.culling)?;
        met.is_within_limits().then(|| met.hit(left.triangle))
    }

    fn closest(&self, ray: &Ray) -> Hit {
        self.trace(ray, Query::Closest)
    }

    fn trace(&self, ray: &Ray, query: Query) -> Hit {
        // It was read where a ray needs it.
        let Some(tree) = &self.copy else { return Hit::MISS };
        exact::trace(&tree.view(), &self.input.mesh, ray, &self.input.query, query, &mut ())
    }

    /// What is left of the light of a shadow ray: as the CPU's kernel has it.
    fn through_glass(&self, left: &Left) -> [f32; 4] {
        let scene =
            SceneWords { words: self.input.scene.words(), frame: &self.frame, environment: None };
        let (mut ray, mut light) = (left.ray, left.light);
        for layer in 0..=MOST_CLEAR_LAYERS {
            let hit = self.closest(&ray);
            if !hit.is_hit() {
                break;
            }
            if layer == MOST_CLEAR_LAYERS || !self.input.scene.is_clear(hit.triangle) {
                return [0.0; 4];
            }
            light = mul(light, scene.second_colour(scene.material_of(hit.triangle)));
            if greatest(light) <= 0.0 {
                break;
            }
            ray = ray.with_limits(after(hit.t), ray.t_max);
        }
        let [r, g, b] = light;
        [r, g, b, 0.0]
    }

    /// Writes answers to their places.
    fn send(
        &self,
        left: &[Left],
        answers: &[[u8; ANSWER]],
        answered: &wgpu::Buffer,
    ) -> Result<(), RenderError> {
        let gpu = self.gpu;
        let bytes = answers.as_flattened();
        let usage = Usage::COPY_SRC | Usage::COPY_DST;
        let sent = gpu.buffer("answers of the CPU", bytes.len() as u64, usage)?;
        gpu.write(&sent, 0, bytes);
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        let mut from = 0;
        for run in left.chunk_by(|a, b| a.index + 1 == b.index) {
            let bytes = (run.len() * ANSWER) as u64;
            let to = u64::from(run[0].index) * ANSWER as u64;
            encoder.copy_buffer_to_buffer(&sent, from, answered, to, bytes);
            from += bytes;
        }
        let recorded = gpu.guard(|| encoder.finish())?;
        gpu.submit([recorded])?;
        Ok(())
    }
}

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
}
