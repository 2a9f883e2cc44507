//! The sweep: every tree is built and traced in turn, round by round, so that a machine whose speed
//! drifts slows all settings alike.

use super::budget::{Budget, Fixed, Pilot, divide};
use super::held::Held;
use super::hierarchy::Beside;
use super::interval::Interval;
use super::judge::Judge;
use super::pareto::Standing;
use super::payback::Payback;
use super::picture::PictureTrade;
use super::plan::{Device, Station};
use super::rays::{RaySets, judged, timed as timed_rays};
use super::row::{Aims, Apart, Errors, KINDS, Row, Sets, Trace};
use super::{TradeError, bvh};
use crate::paper::scene::Placed;
use crate::paper::timing::timed;
use crate::paper::{median, pool};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::BuildConfig;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::report::BackendInfo;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::stats::TreeStats;
use splitplane_core::watch::Watch;
use splitplane_cpu::CpuBackend;
use splitplane_render::Size;
use splitplane_verify::reference::Reference;
use std::collections::{HashMap, hash_map};

/// How to measure.
#[derive(Clone, Copy)]
pub struct Settings<'a> {
    /// Seconds that the rounds are to take together.
    pub seconds: f64,
    /// What is fixed, whatever time it takes.
    pub fixed: Fixed,
    /// The GPU, for stations on it; without one they are measured on the CPU.
    pub gpu: Option<&'a dyn Backend>,
    /// Most bytes of a build.
    pub max_memory: Option<u64>,
    /// Whether settings of the same tree become one row; not where rows of an earlier run are repeated.
    pub merge: bool,
    /// Whether a bounding volume hierarchy takes its turn, too.
    pub hierarchy: bool,
    /// The size of pictures whose settings are tried, too; none for no pictures.
    pub picture: Option<Size>,
    /// Asked again and again whether to go on.
    pub watch: &'a dyn Watch,
}

/// What there is to see while it goes on.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// So many steps are to come.
    Steps(u64),
    /// One of them is done.
    Step(&'a str),
}

/// What was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// How much was.
    pub budget: Budget,
    /// The rows, without conclusions: [`super::document`] draws them.
    pub rows: Vec<Row>,
    /// What a bounding volume hierarchy takes; none where none was asked for, or nothing ran on the CPU.
    pub hierarchy: Option<bvh::Measured>,
    /// What pictures lose by their settings.
    pub picture: Option<PictureTrade>,
    /// What the independent reference says of the exact answers.
    pub held: Held,
    /// The name of the timed rays, see [`super::rays::digest`].
    pub rays: String,
    /// The name of the mesh.
    pub mesh: String,
    /// The CPU backend.
    pub cpu: BackendInfo,
    /// The GPU backend, if it was measured.
    pub gpu: Option<BackendInfo>,
}

/// Times this much above the median of their rounds are measured again.
pub(super) const OUTLIER: f64 = 1.3;

/// Builds that take less are done twice in a row, and the second counts.
pub(super) const WARM_MS: f64 = 500.0;

/// Rays of the first look at a device.
const PILOT_RAYS: usize = 1 << 11;

/// Measures the stations on a scene.
///
/// # Errors
/// A backend that cannot be opened, a tree that cannot be built, rays that cannot be traced; `Cancelled` by
/// `watch`.
pub fn measure(
    placed: &Placed,
    stations: &[Station],
    settings: &Settings<'_>,
    event: &mut dyn FnMut(Event<'_>),
) -> Result<Measured, TradeError> {
    let mesh = placed.scene.mesh()?;
    let bench = Bench::open(&mesh, stations, settings)?;
    let (reference, base) = bench.all.install(|| {
        let base = bench.build_fast(Device::Cpu)?;
        Ok::<_, TradeError>((Reference::new(&mesh), base))
    })?;
    let sets =
        |count: usize| bench.all.install(|| timed_rays(placed, base.as_ref(), &reference, count));
    let pilots = bench.pilots(&sets(PILOT_RAYS)?)?;
    let pilot = |device: Device| pilots[usize::from(device == Device::Gpu)];
    let budget = divide(settings.seconds, stations, pilot, &settings.fixed);
    let sets = sets(budget.cpu.sample_rays.max(budget.gpu.sample_rays))?;
    event(Event::Steps(
        (budget.repeat as u64 + 1) * stations.len() as u64
            + 1
            + u64::from(settings.picture.is_some()),
    ));
    let errors = bench.all.install(|| {
        let count = budget.cpu.error_rays.max(budget.gpu.error_rays);
        let rays = judged(&reference, &sets, count);
        let exact = exact_answers(base.as_ref(), &rays, settings.watch)?;
        Ok::<_, TradeError>(Judged { rays, exact, judge: Judge::new(&mesh, &reference) })
    })?;
    let held = bench.all.install(|| errors.judge.hold(&errors.rays, &errors.exact));
    drop(base);
    event(Event::Step("exact answers"));
    let mut entries: Vec<Entry> =
        stations.iter().map(|station| Entry::new(station, &budget)).collect();
    let mut beside = bench.beside(stations, settings, &budget);
    for round in 0..=budget.repeat {
        // First and last in turns, as the settings are.
        let first = round.is_multiple_of(2);
        let hierarchy = |beside: &mut Option<Beside>| {
            let Some(beside) = beside else { return };
            bench.all.install(|| {
                let built = beside.round(&sets, round > 0);
                if round == 0 {
                    beside.judge(&built, &errors.rays, &errors.exact);
                }
            });
        };
        if first {
            hierarchy(&mut beside);
        }
        for place in in_turns(round, stations.len()) {
            let (station, entry) = (&stations[place], &mut entries[place]);
            if entry.merged {
                event(Event::Step(&station.name));
                continue;
            }
            entry.round(&bench, &sets, round > 0)?;
            if round == 0 {
                // Answers do not depend on threads: one of these stations is enough.
                let first = stations.iter().position(|other| other.answers_as(station));
                if first == Some(place) {
                    bench.all.install(|| entry.judge(&errors, settings.watch))?;
                }
                entry.forget();
            }
            event(Event::Step(&station.name));
        }
        if !first {
            hierarchy(&mut beside);
        }
        if round == 0 && settings.merge {
            merge(&mut entries);
        }
    }
    for entry in &mut entries {
        entry.look_again(&bench, &sets)?;
    }
    if let Some(beside) = &mut beside {
        bench.all.install(|| beside.look_again(&sets));
    }
    let picture = |size: Size| {
        let watch = settings.watch;
        bench.all.install(|| PictureTrade::measure(placed, size, settings.max_memory, watch))
    };
    let picture = settings.picture.map(picture).transpose()?;
    event(Event::Step("pictures"));
    let answers: HashMap<usize, Vec<Judgement>> = (0..stations.len())
        .filter(|&place| !entries[place].merged)
        .filter_map(|place| {
            let same = |other: &Station| other.answers_as(&stations[place]);
            let judged = stations.iter().position(same)?;
            Some((place, entries[judged].judgements.clone()))
        })
        .collect();
    let rows = entries
        .into_iter()
        .enumerate()
        .filter(|(_, entry)| !entry.merged)
        .flat_map(|(place, entry)| entry.rows(answers.get(&place).map_or(&[], Vec::as_slice)));
    Ok(Measured {
        budget,
        rows: rows.enumerate().map(|(i, row)| Row { number: i + 1, ..row }).collect(),
        hierarchy: beside.map(Beside::measured),
        picture,
        held,
        rays: super::rays::digest(sets.each()),
        mesh: name_of(&mesh),
        cpu: bench.cpu.describe(),
        gpu: bench.gpu.map(|backend| backend.describe()),
    })
}

/// Makes one of settings of the same preset, device and threads whose trees have the same nodes and references: the first
/// stands for them all.
fn merge(entries: &mut [Entry<'_>]) {
    for place in 1..entries.len() {
        let (before, rest) = entries.split_at_mut(place);
        let Some(own) = rest.first_mut() else { return };
        let same = |other: &&mut Entry<'_>| !other.merged && other.stands_for(own);
        if let Some(first) = before.iter_mut().find(same) {
            first.also.push(own.station.name.clone());
            own.merged = true;
        }
    }
}

/// Places in the order of a round: every other round backwards, so that drift within rounds cancels.
fn in_turns(round: usize, count: usize) -> Box<dyn Iterator<Item = usize>> {
    if round.is_multiple_of(2) { Box::new(0..count) } else { Box::new((0..count).rev()) }
}

/// XXH64 over nodes and references.
fn name_of_nodes(tree: &KdTreeView<'_>) -> u64 {
    let mut state = splitplane_core::tree::digest::Xxh64::new(0);
    for node in tree.nodes {
        state.write_words(&node.words());
    }
    state.write_words(tree.references);
    state.finish()
}

/// XXH64 over all corners.
fn name_of(mesh: &Mesh<'_>) -> String {
    let mut state = splitplane_core::tree::digest::Xxh64::new(0);
    for index in 0..mesh.len() {
        let bits: Vec<u32> =
            mesh.triangle(index).as_flattened().iter().map(|x| x.to_bits()).collect();
        state.write_words(&bits);
    }
    format!("{:016x}", state.finish())
}

/// The exact answers: those of the CPU backend at accuracy `exact`.
fn exact_answers(
    tree: &dyn Accelerator,
    rays: &Aims<Vec<Ray>>,
    watch: &dyn Watch,
) -> Result<Aims<Vec<Hit>>, TradeError> {
    let options =
        QueryOptions { accuracy: Accuracy::Exact, watch: Some(watch), ..QueryOptions::default() };
    let mut exact: [Vec<Hit>; KINDS] = Default::default();
    for (exact, rays) in exact.iter_mut().zip(rays.each()) {
        exact.resize(rays.len(), Hit::MISS);
        tree.closest_hits(rays, exact, &options)?;
    }
    Ok(Aims::of(exact))
}

/// What only was asked for any hit, in hits that can be judged: the exact one where the answer is that of
/// the exact one, else a miss, or the closest hit of the same tree, which stands for what was met. One
/// that is a miss itself explains nothing: a hit of no place stands for it. The number is of rays left
/// undecided.
fn any_answers(
    tree: &dyn Accelerator,
    rays: &[Ray],
    exact: &[Hit],
    options: &QueryOptions<'_>,
) -> Result<(Vec<Hit>, u64), TradeError> {
    let mut stopped = vec![false; rays.len()];
    let undecided = tree.any_hits(rays, &mut stopped, options)?.undecided;
    let answer = |((ray, exact), stopped): ((&Ray, &Hit), &bool)| {
        let mut hit = [Hit::MISS];
        match (*stopped, exact.is_hit()) {
            (true, false) => {
                tree.closest_hits(&[*ray], &mut hit, options)?;
                Ok(if hit[0].is_hit() { hit[0] } else { NOWHERE })
            }
            (true, true) => Ok(*exact),
            (false, _) => Ok(Hit::MISS),
        }
    };
    let hits: Result<Vec<Hit>, TradeError> =
        rays.iter().zip(exact).zip(&stopped).map(answer).collect();
    Ok((hits?, undecided))
}

/// Of the first triangle, at no distance.
const NOWHERE: Hit = Hit { t: f32::NAN, triangle: 0, u: f32::NAN, v: f32::NAN };

/// What all stations share.
struct Bench<'a> {
    mesh: &'a Mesh<'a>,
    cpu: CpuBackend,
    gpu: Option<&'a dyn Backend>,
    pools: HashMap<usize, rayon::ThreadPool>,
    /// The pool with most threads, for all that is not timed.
    all: rayon::ThreadPool,
    max_memory: Option<u64>,
    watch: &'a dyn Watch,
}

/// The rays that are judged, and their exact answers.
struct Judged<'a> {
    rays: Aims<Vec<Ray>>,
    exact: Aims<Vec<Hit>>,
    judge: Judge<'a>,
}

impl<'a> Bench<'a> {
    fn open(
        mesh: &'a Mesh<'a>,
        stations: &[Station],
        settings: &Settings<'a>,
    ) -> Result<Bench<'a>, TradeError> {
        let mut pools = HashMap::new();
        for station in stations {
            if let hash_map::Entry::Vacant(place) = pools.entry(station.threads) {
                place.insert(pool(station.threads)?);
            }
        }
        let most = stations.iter().map(|station| station.threads).max().unwrap_or(1);
        let cpu = CpuBackend::new();
        let Settings { gpu, max_memory, watch, .. } = *settings;
        Ok(Bench { mesh, cpu, gpu, pools, all: pool(most)?, max_memory, watch })
    }

    fn build(
        &self,
        device: Device,
        name: &str,
        config: &BuildConfig,
        layout: QueryLayout,
    ) -> Result<Box<dyn Accelerator>, TradeError> {
        let (max_memory, watch) = (self.max_memory, Some(self.watch));
        let options = BuildOptions { config: *config, max_memory, layout, watch };
        let built = match (device, self.gpu) {
            (Device::Gpu, Some(backend)) => backend.build(self.mesh, &options),
            _ => self.cpu.build(self.mesh, &options),
        };
        built.map_err(|error| TradeError::Build { setting: name.to_owned(), error })
    }

    /// Preset `fast` as it is.
    fn build_fast(&self, device: Device) -> Result<Box<dyn Accelerator>, TradeError> {
        self.build(device, "fast", &BuildConfig::default(), QueryLayout::Fast)
    }

    /// The hierarchy, where one is asked for and trees are measured on all threads of the CPU.
    fn beside(
        &self,
        stations: &[Station],
        settings: &Settings<'_>,
        budget: &Budget,
    ) -> Option<Beside> {
        let threads = self.all.current_num_threads();
        let on_cpu =
            |station: &Station| station.device == Device::Cpu && station.threads == threads;
        (settings.hierarchy && stations.iter().any(on_cpu))
            .then(|| Beside::new(self.mesh, threads, budget.cpu.sample_rays))
    }

    fn pool(&self, station: &Station) -> &rayon::ThreadPool {
        self.pools.get(&station.threads).unwrap_or(&self.all)
    }

    /// What preset `fast` takes on the CPU and on the GPU.
    fn pilots(&self, sets: &RaySets) -> Result<[Pilot; 2], TradeError> {
        let pilot = |device: Device| {
            self.all.install(|| {
                let (tree, mut build_ms) = timed(|| self.build_fast(device));
                let tree = tree?;
                let mut ns_per_ray = [0.0; 3];
                // The first time warms up.
                for _ in 0..2 {
                    for (ns, accuracy) in ns_per_ray.iter_mut().zip(Accuracy::ALL) {
                        let mut own = Vec::new();
                        for set in 0..4 {
                            let (ms, rays) = trace(tree.as_ref(), sets, set, accuracy, self.watch)?;
                            own.extend((rays > 0).then(|| 1e6 * ms / rays as f64));
                        }
                        *ns = mean(&own);
                    }
                }
                if device == Device::Cpu {
                    build_ms = timed(|| self.build_fast(device)).1.min(build_ms);
                }
                Ok::<Pilot, TradeError>(Pilot { build_ms, ns_per_ray })
            })
        };
        let cpu = pilot(Device::Cpu)?;
        Ok([cpu, if self.gpu.is_some() { pilot(Device::Gpu)? } else { cpu }])
    }
}

fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
}

/// Milliseconds to trace a set, as one batch from and to host memory, and how many rays it has.
fn trace(
    tree: &dyn Accelerator,
    sets: &RaySets,
    set: usize,
    accuracy: Accuracy,
    watch: &dyn Watch,
) -> Result<(f64, usize), TradeError> {
    trace_first(tree, sets.each()[set], set == SHADOW, accuracy, watch)
}

/// The set of which only is asked whether anything is hit.
pub(super) const SHADOW: usize = 1;

fn trace_first(
    tree: &dyn Accelerator,
    rays: &[Ray],
    any: bool,
    accuracy: Accuracy,
    watch: &dyn Watch,
) -> Result<(f64, usize), TradeError> {
    let options = QueryOptions { accuracy, watch: Some(watch), ..QueryOptions::default() };
    let (traced, ms) = if any {
        let mut stopped = vec![false; rays.len()];
        timed(|| tree.any_hits(rays, &mut stopped, &options))
    } else {
        let mut hits = vec![Hit::MISS; rays.len()];
        timed(|| tree.closest_hits(rays, &mut hits, &options))
    };
    traced?;
    Ok((ms, rays.len()))
}

/// Errors of one accuracy, and rays decided elsewhere.
#[derive(Clone, Copy, Debug)]
struct Judgement {
    errors: Aims<Errors>,
    redone: u64,
}

/// A station at work, and what it has taken so far.
struct Entry<'a> {
    station: &'a Station,
    budget: Budget,
    build_ms: Vec<f64>,
    /// Nanoseconds a ray, by accuracy and set.
    ns: Vec<[Vec<f64>; 4]>,
    rays: [usize; 4],
    /// Settings of the same tree.
    also: Vec<String>,
    /// Another one stands for it.
    merged: bool,
    /// Rounds measured again.
    again: usize,
    /// The tree of the first round, until it is judged.
    tree: Option<Box<dyn Accelerator>>,
    judgements: Vec<Judgement>,
    like: Option<Likeness>,
}

/// What a tree is like, whoever traces through it.
struct Likeness {
    stats: TreeStats,
    digest: String,
    /// A name of nodes and references alone; the digest counts what shaped them, too.
    tree: u64,
    query_bytes: u64,
    peak_bytes: u64,
}

impl<'a> Entry<'a> {
    fn new(station: &'a Station, budget: &Budget) -> Entry<'a> {
        Entry {
            station,
            budget: *budget,
            build_ms: Vec::new(),
            ns: station.accuracies.iter().map(|_| Default::default()).collect(),
            rays: [0; 4],
            also: Vec::new(),
            merged: false,
            again: 0,
            tree: None,
            judgements: Vec::new(),
            like: None,
        }
    }

    /// Builds and traces once.
    fn round(&mut self, bench: &Bench<'_>, sets: &RaySets, counts: bool) -> Result<(), TradeError> {
        let Station { name, config, layout, device, .. } = self.station;
        let most = self.budget.of(*device).sample_rays;
        bench.pool(self.station).install(|| {
            let build = || bench.build(*device, name, config, *layout);
            let (mut tree, mut build_ms) = timed(build);
            if build_ms < WARM_MS {
                // What ran before it, another tree on other threads, left caches and memory as it did.
                drop(tree?);
                (tree, build_ms) = timed(build);
            }
            let tree = tree?;
            for (place, &accuracy) in self.station.accuracies.iter().enumerate() {
                for (set, rays) in sets.each().into_iter().enumerate() {
                    let rays = &rays[..rays.len().min(most)];
                    let any = set == SHADOW;
                    let (ms, rays) = trace_first(tree.as_ref(), rays, any, accuracy, bench.watch)?;
                    self.rays[set] = rays;
                    if counts && rays > 0 {
                        self.ns[place][set].push(1e6 * ms / rays as f64);
                    }
                }
            }
            if counts {
                self.build_ms.push(build_ms);
            } else {
                self.like = Some(Likeness::of(tree.as_ref()));
                self.tree = Some(tree);
            }
            Ok(())
        })
    }

    /// Judges the answers of the tree of the first round.
    fn judge(&mut self, judged: &Judged<'_>, watch: &dyn Watch) -> Result<(), TradeError> {
        let Some(tree) = &self.tree else { return Ok(()) };
        let most = self.budget.of(self.station.device).error_rays as usize;
        for &accuracy in &self.station.accuracies {
            let options = QueryOptions { accuracy, watch: Some(watch), ..QueryOptions::default() };
            let (mut errors, mut redone) = ([Errors::default(); KINDS], 0);
            for (kind, errors) in errors.iter_mut().enumerate() {
                let (rays, exact) = (judged.rays.each()[kind], judged.exact.each()[kind]);
                let count = rays.len().min(most);
                let (rays, exact) = (&rays[..count], &exact[..count]);
                let (hits, undecided) = match Aims::<()>::NAMES[kind] {
                    "shadow" => any_answers(tree.as_ref(), rays, exact, &options)?,
                    _ => {
                        let mut hits = vec![Hit::MISS; count];
                        let told = tree.closest_hits(rays, &mut hits, &options)?;
                        (hits, told.undecided)
                    }
                };
                redone += undecided;
                *errors = judged.judge.count(rays, exact, &hits);
                if Aims::<()>::NAMES[kind] == "shadow" {
                    // Whether anything is hit has no place, and so no size.
                    let none = Apart::default();
                    *errors =
                        Errors { same: none, other: none, outline: none, off: none, ..*errors };
                }
            }
            self.judgements.push(Judgement { errors: Aims::of(errors), redone });
        }
        Ok(())
    }

    /// Whether its rows are another's rows too.
    fn stands_for(&self, other: &Entry<'_>) -> bool {
        let (own, its) = (self.station, other.station);
        let of = |station: &Station| {
            (station.config.preset(), station.layout, station.device, station.threads)
        };
        let tree = |entry: &Entry<'_>| entry.like.as_ref().map(|like| like.tree);
        of(own) == of(its)
            && its.accuracies.iter().all(|accuracy| own.accuracies.contains(accuracy))
            && tree(self).is_some()
            && tree(self) == tree(other)
    }

    /// Measures rounds again in which a time was far above the median of all rounds, twice at most.
    fn look_again(&mut self, bench: &Bench<'_>, sets: &RaySets) -> Result<(), TradeError> {
        for _ in 0..2 {
            let Some(round) = self.outlier().filter(|_| !self.merged) else { return Ok(()) };
            self.build_ms.remove(round);
            for times in self.ns.iter_mut().flatten().filter(|times| !times.is_empty()) {
                times.remove(round);
            }
            self.again += 1;
            self.round(bench, sets, true)?;
        }
        Ok(())
    }

    /// A round in which the build or a set took far longer than it usually does.
    fn outlier(&self) -> Option<usize> {
        let far = |times: &Vec<f64>| far_above(times, OUTLIER);
        far(&self.build_ms).or_else(|| self.ns.iter().flatten().find_map(far))
    }

    /// Lets the tree go.
    fn forget(&mut self) {
        self.tree = None;
    }

    /// A row for each accuracy, not yet numbered and without conclusions.
    fn rows(self, judgements: &[Judgement]) -> Vec<Row> {
        let Entry { station, build_ms, ns, rays, like, also, again, .. } = self;
        let Some(like) = like else { return Vec::new() };
        let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
        let row = |(place, times): (usize, [Vec<f64>; 4])| {
            let judgement = judgements.get(place).copied();
            let errors = judgement.map_or(Aims::default(), |judgement| judgement.errors);
            // The median of what the interval is of: not the mean of the sets' medians, which may lie outside.
            let by_round = ns_by_round(&times);
            let mut set = 0;
            let trace = times.map(|times| {
                set += 1;
                let any = !times.is_empty();
                let least_ns = any.then(|| least(&times));
                Trace { rays: rays[set - 1], ns: any.then(|| median(times)), least_ns }
            });
            let judged: u64 = errors.each().into_iter().map(|errors| errors.rays).sum();
            let per_million = |count: u64| 1e6 * count as f64 / judged.max(1) as f64;
            let unaimed = Aims::<()>::NAMES.into_iter().zip(errors.each());
            let unaimed = unaimed.filter(|(kind, _)| !Aims::<()>::AIMED.contains(kind));
            let [wrong, all] = unaimed.fold([0, 0], |[wrong, all], (_, errors)| {
                [wrong + errors.all(), all + errors.rays]
            });
            let threads = (station.device == Device::Cpu).then_some(station.threads);
            Row {
                number: 0,
                name: station.name.clone(),
                preset: station.config.preset().name().to_owned(),
                knob: station.knob.clone(),
                layout: station.layout.name().to_owned(),
                also: also.clone(),
                config: station.config.into(),
                backend: station.device.name().to_owned(),
                threads,
                accuracy: station.accuracies[place].name().to_owned(),
                build_ms: median(build_ms.clone()),
                least_build_ms: least(&build_ms),
                build_interval: Interval::of(&build_ms),
                trace: Sets::of(trace),
                ns_interval: Interval::of(&by_round),
                ns_per_ray: median(by_round),
                again,
                query_bytes: like.query_bytes,
                peak_bytes: like.peak_bytes,
                sah_cost: like.stats.sah_cost,
                block_cost: like.stats.block_cost,
                nodes: like.stats.nodes,
                references: like.stats.references,
                depth: like.stats.max_depth,
                digest: like.digest.clone(),
                tree: format!("{:016x}", like.tree),
                errors,
                errors_per_million: per_million(errors.each().into_iter().map(Errors::all).sum()),
                unaimed_errors_per_million: 1e6 * wrong as f64 / all.max(1) as f64,
                rounded_per_million: per_million(
                    errors.each().into_iter().map(|errors| errors.rounded).sum(),
                ),
                redone_per_million: per_million(judgement.map_or(0, |judgement| judgement.redone)),
                field: String::new(),
                pareto: Standing::Beaten,
                payback: Payback::Unknown,
            }
        };
        ns.into_iter().enumerate().map(row).collect()
    }
}

/// Nanoseconds a ray in each round, the mean over the sets.
pub(super) fn ns_by_round(times: &[Vec<f64>; 4]) -> Vec<f64> {
    let rounds = times.iter().map(Vec::len).max().unwrap_or(0);
    let of = |round: usize| {
        let own: Vec<f64> = times.iter().filter_map(|set| set.get(round).copied()).collect();
        mean(&own)
    };
    (0..rounds).map(of).collect()
}

/// The first of at least three times that is this many times their median.
pub(super) fn far_above(times: &[f64], factor: f64) -> Option<usize> {
    let usual = median(times.to_vec());
    times.iter().position(|&time| times.len() >= 3 && time > factor * usual)
}

impl Likeness {
    fn of(tree: &dyn Accelerator) -> Likeness {
        let view = tree.tree().view();
        // One K_T, K_I and W for all, whatever shaped the tree: else costs do not compare.
        let fast = BuildConfig::default();
        let config = BuildConfig {
            traversal_cost: fast.traversal_cost,
            intersection_cost: fast.intersection_cost,
            block_width: fast.block_width,
            ..view.config
        };
        Likeness {
            stats: TreeStats::of(&KdTreeView { config, ..view }),
            digest: tree.tree().digest().to_string(),
            tree: name_of_nodes(&view),
            query_bytes: tree.query_bytes(),
            peak_bytes: tree.summary().peak_bytes,
        }
    }
}
