//! The stations at work, round by round.

use super::answers::{Judged, any_answers};
use super::bench::Bench;
use super::likeness::Likeness;
use super::trace::trace;
use crate::paper::median;
use crate::paper::timing::timed;
use crate::trade::TradeError;
use crate::trade::budget::Budget;
use crate::trade::interval::Interval;
use crate::trade::pareto::Standing;
use crate::trade::payback::Payback;
use crate::trade::plan::{Device, Station};
use crate::trade::rays::RaySets;
use crate::trade::rounds::{OUTLIER, WARM_MS, far_above, ns_by_round};
use crate::trade::row::{Aims, Apart, Errors, KINDS, Row, Sets, Trace};
use splitplane_core::backend::Accelerator;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_core::watch::Watch;

/// Errors of one accuracy, and rays decided elsewhere.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judgement {
    errors: Aims<Errors>,
    redone: u64,
}

/// A station at work, and what it has taken so far.
pub(super) struct Entry<'a> {
    station: &'a Station,
    budget: Budget,
    build_ms: Vec<f64>,
    /// Nanoseconds a ray, by accuracy and set.
    ns: Vec<[Vec<f64>; 4]>,
    rays: [usize; 4],
    /// Settings of the same tree.
    also: Vec<String>,
    /// Another one stands for it.
    pub(super) merged: bool,
    /// Rounds measured again.
    again: usize,
    /// The tree of the first round, until it is judged.
    tree: Option<Box<dyn Accelerator>>,
    pub(super) judgements: Vec<Judgement>,
    like: Option<Likeness>,
}

impl<'a> Entry<'a> {
    pub(super) fn new(station: &'a Station, budget: &Budget) -> Entry<'a> {
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
    pub(super) fn round(
        &mut self,
        bench: &Bench<'_>,
        sets: &RaySets,
        counts: bool,
    ) -> Result<(), TradeError> {
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
                    let any = set == Sets::<()>::SHADOW;
                    let (ms, rays) = trace(tree.as_ref(), rays, any, accuracy, bench.watch)?;
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
    pub(super) fn judge(
        &mut self,
        judged: &Judged<'_>,
        watch: &dyn Watch,
    ) -> Result<(), TradeError> {
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
    pub(super) fn look_again(
        &mut self,
        bench: &Bench<'_>,
        sets: &RaySets,
    ) -> Result<(), TradeError> {
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
    pub(super) fn forget(&mut self) {
        self.tree = None;
    }

    /// A row for each accuracy, not yet numbered and without conclusions.
    pub(super) fn rows(self, judgements: &[Judgement]) -> Vec<Row> {
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

/// Makes one of settings of the same preset, device and threads whose trees have the same nodes and references: the first
/// stands for them all.
pub(super) fn merge(entries: &mut [Entry<'_>]) {
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
