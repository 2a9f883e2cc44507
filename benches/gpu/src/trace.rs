//! Queries: rays that stay on the device, rays from host memory, and the CPU's, by turns.

use serde::Serialize;
use splitplane::gpu::query::UNFINISHED;
use splitplane::gpu::{DeviceQueryError, Gpu};
use splitplane::{Accelerator, Hit, QueryOptions, Ray};
use wgpu::BufferUsages as Usage;

use crate::Failure;
use crate::build::Built;
use crate::device::{Clock, Span, read_back, warm};
use crate::options::Options;
use crate::rays::Set;
use crate::stats::{median, milliseconds};

/// What is asked of a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Query {
    Closest,
    Any,
}

impl Query {
    pub(crate) const ALL: [Query; 2] = [Query::Closest, Query::Any];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Query::Closest => "closest",
            Query::Any => "any",
        }
    }

    /// Bytes of an answer on the device.
    const fn answer_bytes(self) -> u64 {
        match self {
            Query::Closest => size_of::<Hit>() as u64,
            Query::Any => 4,
        }
    }
}

/// The figures of one set and query. Rays that were not compared are none.
#[derive(Debug, Serialize)]
pub(crate) struct Figures {
    pub set: &'static str,
    pub query: Query,
    pub rays: usize,
    pub hits: usize,
    /// Rays of the set that were left out, since one binding of the device does not hold them.
    pub left_out: usize,
    /// Answers that are not the CPU's in every bit: of the batch from host memory, and of the rays
    /// on the device where they were traced.
    pub different: usize,
    pub resident_different: Option<usize>,
    /// Rays on the device that the driver did not let finish. (From host memory such rays are
    /// answered by the CPU.)
    pub unfinished: usize,
    pub first_difference: Option<String>,
    /// Dispatches in a submission of the resident figures.
    pub dispatches: u32,
    /// Seconds for one dispatch of all rays, on the device's clock and on the host's.
    pub resident_device_s: Vec<f64>,
    pub resident_wall_s: Vec<f64>,
    /// Seconds from host memory to host memory.
    pub host_s: Vec<f64>,
    pub cpu_s: Vec<f64>,
}

/// Submissions of resident rays are filled up to this long.
const FILLED_MS: f64 = 50.0;
/// Most dispatches of a submission.
const MOST_DISPATCHES: f64 = 64.0;

/// Answers of either query, as words to compare.
#[derive(Clone)]
enum Answers {
    Closest(Vec<Hit>),
    Any(Vec<bool>),
}

impl Answers {
    fn new(query: Query, rays: usize) -> Answers {
        match query {
            Query::Closest => Answers::Closest(vec![Hit::MISS; rays]),
            Query::Any => Answers::Any(vec![false; rays]),
        }
    }

    fn trace(&mut self, accelerator: &dyn Accelerator, rays: &[Ray]) -> Result<(), Failure> {
        let options = QueryOptions::default();
        match self {
            Answers::Closest(hits) => accelerator.closest_hits(rays, hits, &options)?,
            Answers::Any(any) => accelerator.any_hits(rays, any, &options)?,
        };
        Ok(())
    }

    /// As [`Answers::trace`] on the device; gives the number of rays that the driver did not let
    /// finish there, which the CPU answers.
    fn trace_counting(&mut self, built: &Built, rays: &[Ray]) -> Result<usize, Failure> {
        let (queries, tree) = (built.gpu.queries(), built.gpu.device_tree());
        let options = QueryOptions::default();
        let traced = match self {
            Answers::Closest(hits) => queries.closest_hits(tree, rays, hits, &options),
            Answers::Any(any) => queries.any_hits(tree, rays, any, &options),
        };
        match traced {
            Ok(()) => Ok(0),
            Err(DeviceQueryError::Unfinished { rays: count, .. }) => {
                self.trace(&built.gpu, rays)?;
                Ok(count)
            }
            Err(error) => Err(error.into()),
        }
    }

    fn hits(&self) -> usize {
        match self {
            Answers::Closest(hits) => hits.iter().filter(|hit| hit.is_hit()).count(),
            Answers::Any(any) => any.iter().filter(|hit| **hit).count(),
        }
    }

    /// The bytes as they are on the device.
    fn words(&self) -> Vec<u32> {
        match self {
            Answers::Closest(hits) => bytemuck::cast_slice(hits).to_vec(),
            Answers::Any(any) => any.iter().map(|&hit| hit.into()).collect(),
        }
    }
}

/// Traces one set on both sides.
pub(crate) fn measure(
    built: &Built,
    set: &Set,
    query: Query,
    options: &Options,
) -> Result<Figures, Failure> {
    let queries = built.gpu.queries();
    let gpu: &Gpu = queries.gpu();
    let most = (gpu.limits().max_storage_buffer_binding_size / 32).min(u64::from(u32::MAX));
    let rays = &set.rays[..set.rays.len().min(most as usize)];
    let mut figures = Figures {
        set: set.name,
        query,
        rays: rays.len(),
        hits: 0,
        left_out: set.rays.len() - rays.len(),
        different: 0,
        resident_different: None,
        unfinished: 0,
        first_difference: None,
        dispatches: 1,
        resident_device_s: Vec::new(),
        resident_wall_s: Vec::new(),
        host_s: Vec::new(),
        cpu_s: Vec::new(),
    };
    if rays.is_empty() {
        return Ok(figures);
    }
    // The first pass of each is compared and not counted.
    let mut of_cpu = Answers::new(query, rays.len());
    let mut of_gpu = of_cpu.clone();
    of_cpu.trace(&built.cpu, rays)?;
    if options.check {
        figures.unfinished = of_gpu.trace_counting(built, rays)?;
    } else {
        of_gpu.trace(&built.gpu, rays)?;
    }
    figures.hits = of_cpu.hits();
    let expected = of_cpu.words();
    figures.different = figures.compare(&expected, &of_gpu.words(), rays, "from host memory");
    if options.check {
        return Ok(figures);
    }

    let resident = Resident::new(built, rays, query, QueryOptions::default())?;
    let first = resident.trace(1)?;
    let words = resident.read()?;
    figures.resident_different = Some(figures.compare(&expected, &words, rays, "on the device"));
    let stride = query.answer_bytes() as usize / 4;
    figures.unfinished = words.chunks_exact(stride).filter(|word| unfinished(word)).count();
    let wanted = FILLED_MS / first.best_ms().max(1e-3);
    figures.dispatches = wanted.ceil().clamp(1.0, MOST_DISPATCHES) as u32;
    let each = 1e-3 / f64::from(figures.dispatches);
    warm(gpu, || resident.trace(figures.dispatches).map(|_| ()))?;
    for _ in 0..options.reps {
        let span = resident.trace(figures.dispatches)?;
        figures.resident_wall_s.push(span.wall_ms * each);
        figures.resident_device_s.extend(span.device_ms.map(|ms| ms * each));
    }
    for _ in 0..options.reps {
        let (done, ms) = milliseconds(|| of_gpu.trace(&built.gpu, rays));
        done?;
        figures.host_s.push(ms * 1e-3);
        let (done, ms) = milliseconds(|| of_cpu.trace(&built.cpu, rays));
        done?;
        figures.cpu_s.push(ms * 1e-3);
    }
    Ok(figures)
}

/// Whether the words are those of a ray that the driver did not let finish.
fn unfinished(words: &[u32]) -> bool {
    match words {
        [any] => *any == 2,
        words => words[1] == UNFINISHED,
    }
}

impl Figures {
    /// How many answers differ; those that did not finish do not count. Keeps the first.
    fn compare(&mut self, expected: &[u32], found: &[u32], rays: &[Ray], how: &str) -> usize {
        let stride = self.query.answer_bytes() as usize / 4;
        let mut different = 0;
        for (i, (expected, found)) in
            expected.chunks_exact(stride).zip(found.chunks_exact(stride)).enumerate()
        {
            if expected == found || unfinished(found) {
                continue;
            }
            different += 1;
            if self.first_difference.is_none() {
                self.first_difference = Some(format!(
                    "ray {i} {how}: {found:08x?}, the CPU {expected:08x?}; {:?}",
                    rays[i]
                ));
            }
        }
        different
    }

    /// Million rays a second from the times of passes; NaN where nothing was timed.
    pub(crate) fn mrays(&self, seconds: &[f64]) -> f64 {
        self.rays as f64 / median(seconds) * 1e-6
    }

    /// The same of the resident rays, on the device's clock where there is one.
    pub(crate) fn resident_mrays(&self) -> f64 {
        let device = &self.resident_device_s;
        self.mrays(if device.is_empty() { &self.resident_wall_s } else { device })
    }
}

/// Rays and answers in device memory.
pub(crate) struct Resident<'a> {
    built: &'a Built,
    clock: Clock<'a>,
    rays: wgpu::Buffer,
    answers: wgpu::Buffer,
    count: u32,
    query: Query,
    options: QueryOptions<'static>,
}

impl<'a> Resident<'a> {
    pub(crate) fn new(
        built: &'a Built,
        rays: &[Ray],
        query: Query,
        options: QueryOptions<'static>,
    ) -> Result<Resident<'a>, Failure> {
        let gpu = built.gpu.queries().gpu();
        let bytes: &[u8] = bytemuck::cast_slice(rays);
        let uploaded = gpu.buffer("rays", bytes.len() as u64, Usage::STORAGE | Usage::COPY_DST)?;
        gpu.queue().write_buffer(&uploaded, 0, bytes);
        let answers = gpu.buffer(
            "answers",
            rays.len() as u64 * query.answer_bytes(),
            Usage::STORAGE | Usage::COPY_SRC,
        )?;
        // The rays are there before anything is timed.
        gpu.submit([])?;
        gpu.wait()?;
        let count = rays.len() as u32;
        let clock = Clock::new(gpu);
        Ok(Resident { built, clock, rays: uploaded, answers, count, query, options })
    }

    pub(crate) fn trace(&self, dispatches: u32) -> Result<Span, Failure> {
        let accelerator = &self.built.gpu;
        let (queries, tree) = (accelerator.queries(), accelerator.device_tree());
        let options = &self.options;
        let (rays, answers, count) = (&self.rays, &self.answers, self.count);
        self.clock.time(|encoder| {
            for _ in 0..dispatches {
                match self.query {
                    Query::Closest => {
                        queries
                            .record_closest_hits(encoder, tree, rays, answers, count, options)?;
                    }
                    Query::Any => {
                        queries.record_any_hits(encoder, tree, rays, answers, count, options)?;
                    }
                }
            }
            Ok(())
        })
    }

    pub(crate) fn read(&self) -> Result<Vec<u32>, Failure> {
        let bytes = u64::from(self.count) * self.query.answer_bytes();
        let bytes = read_back(self.built.gpu.queries().gpu(), &self.answers, bytes)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}
