//! The self-test of a device when it is opened: the guarded operations, one small tree, a few rays,
//! all compared with the bits of the CPU.

use std::sync::Arc;

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::{Arithmetic, Strict, flush, snap};
use splitplane_core::backend::BuildOptions;
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::kernel::{CheckBuffer, CheckKernel, CheckUniform, DeviceChecks, Slot};
use splitplane_core::layout::CheckParameters;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse::{Query, trace};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::digest::Digest;
use splitplane_core::tree::validate::validate_mesh;
use splitplane_core::triangle::{Triangle, prepare};
use wgpu::BufferUsages as Usage;

use crate::builder::shared::Shared;
use crate::builder::source::Source;
use crate::builder::{DeviceBuild, PendingBuild};
use crate::device::gpu::Gpu;
use crate::device::wait::{Wait, blocking};
use crate::device::{DeviceSet, Pipelines, Text, once};
use crate::error::GpuError;
use crate::parity::Parity;
use crate::query::{DeviceQueryError, DeviceTree, Queries};

/// Pairs of operands on which the guarded operations are tested, and as many with results around the least normal
/// number.
const PAIRS: u32 = 4096;
/// Triangles of the small build.
const TRIANGLES: usize = 700;
/// Rays through it.
const RAYS: usize = 512;
/// The digest of the small tree on the CPU; pinned by a test.
pub const DIGEST: Digest = Digest(0x3bb2_3b4d_0a14_e334);

/// Runs the self-test.
///
/// # Errors
/// A device that fails, or that builds a tree that is not valid.
pub(crate) async fn run(wait: Wait, shared: &Arc<Shared>) -> Result<Parity, GpuError> {
    let arithmetic = check_arithmetic(wait, &shared.gpu, &Pipelines::default()).await?;
    let tree = check_tree(wait, shared).await?;
    Ok(match arithmetic.or(tree) {
        None => Parity::Bitwise,
        Some(difference) => Parity::Structural(difference),
    })
}

/// Numbers that are the same in every run.
struct Sequence(u32);

impl Sequence {
    fn next(&mut self) -> u32 {
        // A permuted congruential generator: O'Neill 2014, RXS-M-XS, 32 bits.
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        (word >> 22) ^ word
    }

    /// In [0, 1).
    fn unit(&mut self) -> f32 {
        (self.next() >> 8) as f32 / (1 << 24) as f32
    }

    /// A normal number with an exponent of at most `reach` either way.
    fn float(&mut self, reach: u32) -> f32 {
        let field = 127 - reach + self.next() % (2 * reach + 1);
        f32::from_bits(self.next() & 0x807f_ffff | field << 23)
    }
}

impl DeviceSet for DeviceChecks {
    /// A check has one text.
    type Variant = ();

    fn text(kernel: CheckKernel, (): &()) -> Text {
        let shader = &splitplane_shaders::CHECKS[kernel as usize];
        Text { name: shader.name, parts: shader.parts.into() }
    }
}

/// The guarded operations of one pair, in the order of the kernel.
const OPERATIONS: [&str; 8] = [
    "product",
    "sum",
    "difference",
    "quotient",
    "the rest of a product",
    "the rest of a sum",
    "x z - y z",
    "x y + y z + z x",
];

fn expected(x: f32, y: f32) -> [u32; 8] {
    let z = Strict::sum(x, 1.0);
    let [xy, yz, zx] = [(x, y), (y, z), (z, x)].map(|(a, b)| Strict::product(a, b));
    // A product that underflows has no remainder on a device.
    let (high, low) = Strict::two_product(x, y);
    let rest = if flush(high) == 0.0 { 0.0 } else { low };
    [
        Strict::product(x, y),
        Strict::sum(x, y),
        Strict::difference(x, y),
        Strict::quotient(x, y),
        rest,
        Strict::two_sum(x, y).1,
        Strict::difference(Strict::product(x, z), yz),
        Strict::sum(Strict::sum(xy, yz), zx),
    ]
    .map(|value| snap(value).to_bits())
}

/// The same where the barrier's zero is one, so that the last bit of every guarded result changes. `None` for operations
/// whose result is exact whatever they are made of, or not defined then.
fn expected_through_one(x: f32, y: f32) -> [Option<u32>; 8] {
    let through = |value: f32| f32::from_bits(value.to_bits() ^ 1);
    let product = |a: f32, b: f32| through(a * b);
    let sum = |a: f32, b: f32| through(a + b);
    let difference = |a: f32, b: f32| through(a - b);
    let z = sum(x, 1.0);
    let high = sum(x, y);
    let y_part = difference(high, x);
    let x_part = difference(high, y_part);
    [
        Some(product(x, y)),
        Some(high),
        Some(difference(x, y)),
        Some(Strict::quotient(x, y)),
        None,
        Some(sum(difference(x, x_part), difference(y, y_part))),
        Some(difference(product(x, z), product(y, z))),
        Some(sum(sum(product(x, y), product(y, z)), product(z, x))),
    ]
    .map(|value| value.map(|value| snap(value).to_bits()))
}

/// What the operations that round once give around 2^-126. A device may flush what is below. A product that rounding makes
/// 2^-126 is left out: a device that flushes before it rounds, as SwiftShader does, has zero there.
fn expected_at_the_least(x: f32, y: f32) -> [Option<u32>; 8] {
    let product = Strict::product(x, y);
    let below = (f64::from(x) * f64::from(y)).abs() < f64::from(f32::MIN_POSITIVE);
    let rounded_up = below && product.abs() == f32::MIN_POSITIVE;
    let rounded = [
        (!rounded_up).then_some(product),
        Some(Strict::sum(x, y)),
        Some(Strict::difference(x, y)),
        Some(Strict::quotient(x, y)),
    ];
    let mut expected = [None; 8];
    for (expected, rounded) in expected.iter_mut().zip(rounded) {
        *expected = rounded.map(|rounded| snap(rounded).to_bits());
    }
    expected
}

/// Pairs whose product, quotient, sum or difference lies around 2^-126, one after the other: some a little below or above,
/// some so near that rounding leads there.
fn pairs_at_the_least() -> Vec<[f32; 2]> {
    const LEAST: f32 = f32::MIN_POSITIVE;
    let mut sequence = Sequence(31);
    // The whole range of a factor whose other one is normal.
    let mut mantissa =
        |power: i32| f32::from_bits(sequence.next() & 0x807f_ffff | ((127 + power) as u32) << 23);
    (0..PAIRS)
        .map(|i| {
            let power = -1 - (i as i32 / 128);
            // Some operands have all bits set, or none but the first.
            let x = match i / 8 % 4 {
                0 => f32::from_bits(mantissa(power).to_bits() | 0x7f_ffff),
                1 => f32::from_bits(mantissa(power).to_bits() & !0x7f_ffff),
                _ => mantissa(power),
            };
            // A few floats below what leads to 2^-126, or above.
            let near = |y: f32| f32::from_bits((y.to_bits() - 4).wrapping_add(i % 8));
            match i / 32 % 4 {
                0 => [x, near(LEAST / x.abs()).max(LEAST)],
                // A dividend that is normal, so a divisor above one.
                1 => [near(LEAST * x.abs().recip()).max(LEAST), x.recip()],
                2 => [LEAST * x.abs().recip(), -LEAST * (x.abs().recip() - 1.0).max(1.0)],
                _ => [x, mantissa(-126 - power)],
            }
        })
        .collect()
}

/// The part of the self-test that is about arithmetic, with another text in place of its kernel: for tests that plant
/// faults.
///
/// # Errors
/// A device that fails.
#[doc(hidden)]
pub fn arithmetic_of(gpu: &Gpu, source: String) -> Result<Option<String>, GpuError> {
    let pipelines = Pipelines::default();
    pipelines.replace::<DeviceChecks>(CheckKernel::ArithmeticCheck, Some(source));
    blocking(check_arithmetic(Wait::Blocking, gpu, &pipelines))
}

/// The first operation whose result is not the CPU's.
async fn check_arithmetic(
    wait: Wait,
    gpu: &Gpu,
    pipelines: &Pipelines,
) -> Result<Option<String>, GpuError> {
    let mut sequence = Sequence(1);
    // A third of them near one another, where sums cancel; none whose results leave the range.
    let pairs: Vec<[f32; 2]> = (0..PAIRS)
        .map(|i| {
            let reach = [1, 30, 50][i as usize % 3];
            [sequence.float(reach), sequence.float(reach)]
        })
        .collect();
    let found = run_arithmetic(wait, gpu, pipelines, &pairs, 0).await?;
    let strict = |x, y| expected(x, y).map(Some);
    if let Some(difference) = first_difference(&pairs, &found, strict) {
        return Ok(Some(difference));
    }
    // A compiler that saw through the barrier would take no notice of another zero.
    let found = run_arithmetic(wait, gpu, pipelines, &pairs, 1).await?;
    let difference = first_difference(&pairs, &found, expected_through_one);
    if let Some(difference) = difference {
        return Ok(Some(format!("with a zero of one, {difference}")));
    }
    let pairs = pairs_at_the_least();
    let found = run_arithmetic(wait, gpu, pipelines, &pairs, 0).await?;
    let difference = first_difference(&pairs, &found, expected_at_the_least);
    Ok(difference.map(|difference| format!("around the least normal number, {difference}")))
}

/// The results of all operations for pairs of operands, with this word as the barrier's zero.
async fn run_arithmetic(
    wait: Wait,
    gpu: &Gpu,
    pipelines: &Pipelines,
    pairs: &[[f32; 2]],
    zero: u32,
) -> Result<Vec<u32>, GpuError> {
    let from = gpu.mark();
    let bytes = u64::from(PAIRS) * 32;
    let uniform = gpu.buffer("self-test", 16, Usage::UNIFORM | Usage::COPY_DST)?;
    let operands = gpu.buffer("self-test operands", bytes / 4, Usage::STORAGE | Usage::COPY_DST)?;
    let results = gpu.buffer("self-test results", bytes, Usage::STORAGE | Usage::COPY_SRC)?;
    let readback = gpu.buffer("self-test readback", bytes, Usage::MAP_READ | Usage::COPY_DST)?;
    let commands = gpu.guard(|| {
        let parameters = CheckParameters { zero, count: PAIRS };
        gpu.queue().write_buffer(&uniform, 0, bytemuck::bytes_of(&parameters));
        gpu.queue().write_buffer(&operands, 0, bytemuck::cast_slice(pairs));
        let find = |slot: Slot<DeviceChecks>| {
            let buffer = match slot {
                Slot::Uniform(CheckUniform::CheckParameters) => &uniform,
                Slot::Storage(binding) => match binding.buffer {
                    CheckBuffer::Operands => &operands,
                    CheckBuffer::Results => &results,
                },
            };
            Some(buffer.as_entire_buffer_binding())
        };
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        let kernel = (CheckKernel::ArithmeticCheck, &());
        once::record(gpu, pipelines, &mut encoder, kernel, PAIRS, |bound| find(bound.slot))?;
        encoder.copy_buffer_to_buffer(&results, 0, &readback, 0, bytes);
        Ok(encoder.finish())
    })??;
    gpu.submit([commands])?;
    let found = gpu.read_mapped_by(wait, from, &readback, bytes).await?;
    Ok(bytemuck::pod_collect_to_vec(&found))
}

/// The first result that is not as expected, in words.
fn first_difference(
    pairs: &[[f32; 2]],
    found: &[u32],
    expected: impl Fn(f32, f32) -> [Option<u32>; 8],
) -> Option<String> {
    for ([x, y], found) in pairs.iter().zip(found.chunks_exact(8)) {
        for ((name, expected), found) in OPERATIONS.iter().zip(expected(*x, *y)).zip(found) {
            if let Some(expected) = expected
                && expected != *found
            {
                let [expected, found] = [expected, *found].map(f32::from_bits);
                return Some(format!("{name} of {x:e} and {y:e} is {found:e}, not {expected:e}"));
            }
        }
    }
    None
}

/// The triangles of the small build: of many sizes, some clipped by many planes, some planar, some at
/// one place.
pub fn triangles() -> Vec<Triangle> {
    let mut sequence = Sequence(7);
    (0..TRIANGLES)
        .map(|i| {
            let centre = [sequence.unit(), sequence.unit(), sequence.unit()];
            let size = [0.02, 0.1, 0.7][i % 3];
            let mut corners = [[0.0; 3]; 3].map(|_: [f32; 3]| {
                centre.map(|coordinate| coordinate + size * (sequence.unit() - 0.5))
            });
            if i % 7 == 0 {
                // Planar, on one of a few heights.
                let height = (i % 5) as f32 / 4.0;
                corners = corners.map(|[x, y, _]| [x, y, height]);
            }
            if i % 11 == 0 {
                // A hundredth of the scene, far from it in scale.
                corners = corners.map(|corner| corner.map(|x| 0.5 + x / 128.0));
            }
            corners
        })
        .collect()
}

/// Rays in the scale of the triangles, some of them from far away.
fn rays(triangles: &[Triangle]) -> Vec<Ray> {
    let mut sequence = Sequence(23);
    let scale = Aabb::of_points(triangles.as_flattened()).hi[0];
    (0..RAYS)
        .map(|i| {
            let reach = if i % 8 == 7 { 5000.0 } else { 3.0 } * scale;
            let origin = [0.0; 3].map(|_: f32| reach * (sequence.unit() - 0.4));
            // At a corner, at an edge, or anywhere.
            let [a, b, _] = triangles[sequence.next() as usize % triangles.len()];
            let target = match i % 3 {
                0 => a,
                1 => [0, 1, 2].map(|k| 0.5 * (a[k] + b[k])),
                _ => [0.0; 3].map(|_: f32| scale * sequence.unit()),
            };
            Ray::new(origin, [0, 1, 2].map(|k| target[k] - origin[k]))
        })
        .collect()
}

/// How the small tree, or the rays through it, differ from the CPU's.
async fn check_tree(wait: Wait, shared: &Arc<Shared>) -> Result<Option<String>, GpuError> {
    let triangles = triangles();
    let soup = Mesh::soup(&triangles).map_err(|error| GpuError::Refused(error.to_string()))?;
    let built = build(wait, shared, &soup).await?;
    let tree = built.tree.read_by(wait, &shared.gpu).await?;
    validate_mesh(&tree.view(), &soup)
        .map_err(|violation| GpuError::Refused(format!("it builds broken trees: {violation}")))?;
    if tree.digest() != DIGEST {
        return Ok(Some(format!("a small tree is {}, not {DIGEST}", tree.digest())));
    }
    let difference = check_rays(wait, &shared.queries, &built.tree, &tree, &triangles).await?;
    if difference.is_some() {
        return Ok(difference);
    }
    // So small that every triangle is scaled before the test.
    let tiny: Vec<Triangle> =
        triangles.iter().map(|t| t.map(|corner| corner.map(|x| x * TINY))).collect();
    let soup = Mesh::soup(&tiny).map_err(|error| GpuError::Refused(error.to_string()))?;
    let built = build(wait, shared, &soup).await?;
    let tree = built.tree.read_by(wait, &shared.gpu).await?;
    validate_mesh(&tree.view(), &soup)
        .map_err(|violation| GpuError::Refused(format!("it builds broken trees: {violation}")))?;
    check_rays(wait, &shared.queries, &built.tree, &tree, &tiny).await
}

/// A tree that stays on the device.
async fn build(wait: Wait, shared: &Arc<Shared>, mesh: &Mesh<'_>) -> Result<DeviceBuild, GpuError> {
    let (source, options) = (Source::Host(*mesh), BuildOptions::default());
    let pending = PendingBuild::submit(Arc::clone(shared), &source, &options, false, false);
    let built = match pending {
        Ok(pending) => pending.wait_watched_by(wait, None).await,
        Err(error) => Err(error),
    };
    built.map_err(|error| match error {
        BuildError::Device(DeviceError::Lost { reason }) => GpuError::Lost { reason },
        BuildError::Device(DeviceError::TimedOut { seconds }) => GpuError::TimedOut { seconds },
        other => GpuError::Refused(other.to_string()),
    })
}

/// Scale of the second scene.
const TINY: f32 = 1.0 / (1u64 << 50) as f32;

/// The first ray whose answer differs from the CPU's, on the same tree.
async fn check_rays(
    wait: Wait,
    queries: &Queries,
    device: &DeviceTree,
    tree: &KdTree,
    triangles: &[Triangle],
) -> Result<Option<String>, GpuError> {
    let rays = rays(triangles);
    let options = QueryOptions::default();
    let failed = |error| match error {
        DeviceQueryError::Gpu(error) => error,
        other => GpuError::Refused(other.to_string()),
    };
    let mut hits = vec![Hit::MISS; rays.len()];
    let marked = queries.closest_hits_under(wait, device, &rays, &mut hits, &options, None).await;
    marked.and_then(|marked| marked.none()).map_err(failed)?;
    let mut any = vec![false; rays.len()];
    let marked = queries.any_hits_under(wait, device, &rays, &mut any, &options, None).await;
    marked.and_then(|marked| marked.none()).map_err(failed)?;
    let corners: Vec<Triangle> = triangles.iter().map(|t| prepare(t).corners).collect();
    let scale = device.scene_scale();
    for ((ray, found), any) in rays.iter().zip(&hits).zip(any) {
        let trace =
            |query| trace::<Strict>(&tree.view(), &corners[..], scale, ray, &options, query);
        let expected = trace(Query::Closest);
        if bytemuck::bytes_of(found) != bytemuck::bytes_of(&expected) {
            return Ok(Some(format!("the hit of {ray:?} is {found:?}, not {expected:?}")));
        }
        if any != trace(Query::Any).is_hit() {
            return Ok(Some(format!("whether {ray:?} hits anything is {any}")));
        }
    }
    Ok(None)
}
