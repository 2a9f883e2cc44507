//! What the three accuracies cost on the device, and what `exact` leaves undecided there.

use serde::Serialize;
use splitplane::gpu::query::UNFINISHED;
use splitplane::{Accelerator, Accuracy, Hit, QueryOptions, Ray};

use crate::Failure;
use crate::build::Built;
use crate::device::warm;
use crate::options::Options;
use crate::rays::Set;
use crate::stats::{median, milliseconds};
use crate::trace::{Query, Resident};

/// The figures of one set of rays and one accuracy; closest hits.
#[derive(Debug, Serialize)]
pub(crate) struct Figures {
    pub set: &'static str,
    pub accuracy: &'static str,
    pub rays: usize,
    /// Rays on the device that are left undecided; accuracy `exact` only.
    pub undecided: usize,
    /// Rays on the device that the driver did not let finish.
    pub unfinished: usize,
    /// Accuracy `exact`: answers from host memory, undecided rays redone, that are not the CPU's in every bit.
    pub different: Option<usize>,
    /// Seconds for all rays, in device memory and from host memory.
    pub resident_s: Vec<f64>,
    pub host_s: Vec<f64>,
}

impl Figures {
    pub(crate) fn share(&self) -> f64 {
        self.undecided as f64 / self.rays.max(1) as f64
    }

    /// Nanoseconds a ray; NaN where nothing was timed.
    pub(crate) fn nanoseconds(&self, seconds: &[f64]) -> f64 {
        1e9 * median(seconds) / self.rays.max(1) as f64
    }
}

/// Traces one set by every accuracy, by turns.
pub(crate) fn measure(
    built: &Built,
    set: &Set,
    options: &Options,
) -> Result<Vec<Figures>, Failure> {
    let most = built.gpu.queries().gpu().limits().max_storage_buffer_binding_size / 32;
    let rays = &set.rays[..set.rays.len().min(most.min(u64::from(u32::MAX)) as usize)];
    let mut all = Vec::new();
    let mut resident = Vec::new();
    if rays.is_empty() {
        return Ok(all);
    }
    for accuracy in Accuracy::ALL {
        let query = QueryOptions { accuracy, ..QueryOptions::default() };
        let on_device = Resident::new(built, rays, Query::Closest, query)?;
        on_device.trace(1)?;
        let words = on_device.read()?;
        let of = |mark| words.chunks_exact(4).filter(|hit| hit[1] == mark).count();
        let different = match accuracy {
            Accuracy::Exact => Some(differences(built, rays, &query)?),
            _ => None,
        };
        all.push(Figures {
            set: set.name,
            accuracy: accuracy.name(),
            rays: rays.len(),
            undecided: of(Hit::UNDECIDED),
            unfinished: of(UNFINISHED),
            different,
            resident_s: Vec::new(),
            host_s: Vec::new(),
        });
        resident.push((on_device, query));
    }
    if options.check {
        return Ok(all);
    }
    let mut hits = vec![Hit::MISS; rays.len()];
    warm(built.gpu.queries().gpu(), || resident[0].0.trace(1).map(|_| ()))?;
    for _ in 0..options.reps {
        for ((on_device, _), figures) in resident.iter().zip(&mut all) {
            figures.resident_s.push(1e-3 * on_device.trace(1)?.best_ms());
        }
    }
    for _ in 0..options.reps {
        for ((_, query), figures) in resident.iter().zip(&mut all) {
            let (done, ms) = milliseconds(|| built.gpu.closest_hits(rays, &mut hits, query));
            done?;
            figures.host_s.push(1e-3 * ms);
        }
    }
    Ok(all)
}

/// How many exact hits from host memory differ from the CPU backend's.
fn differences(built: &Built, rays: &[Ray], query: &QueryOptions<'_>) -> Result<usize, Failure> {
    let (mut gpu, mut cpu) = (vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]);
    built.gpu.closest_hits(rays, &mut gpu, query)?;
    built.cpu.closest_hits(rays, &mut cpu, query)?;
    Ok(gpu
        .iter()
        .zip(&cpu)
        .filter(|(a, b)| bytemuck::bytes_of(*a) != bytemuck::bytes_of(*b))
        .count())
}
