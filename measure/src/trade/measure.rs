//! The sweep: every tree is built and traced in turn, round by round, so that a machine whose speed
//! drifts slows all settings alike.

mod answers;
mod bench;
mod entry;
mod likeness;
mod trace;

use super::budget::{Budget, Fixed, divide};
use super::held::Held;
use super::hierarchy::Beside;
use super::judge::Judge;
use super::picture::PictureTrade;
use super::plan::{Device, Station};
use super::rays::{judged, timed as timed_rays};
use super::row::Row;
use super::{TradeError, bvh};
use crate::paper::scene::Placed;
use answers::{Judged, exact_answers};
use bench::Bench;
use entry::{Entry, Judgement, merge};
use splitplane_core::backend::Backend;
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BackendInfo;
use splitplane_core::tree::digest::Xxh64;
use splitplane_core::watch::Watch;
use splitplane_render::Size;
use splitplane_verify::reference::Reference;
use std::collections::HashMap;

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

/// Places in the order of a round: every other round backwards, so that drift within rounds cancels.
fn in_turns(round: usize, count: usize) -> Box<dyn Iterator<Item = usize>> {
    if round.is_multiple_of(2) { Box::new(0..count) } else { Box::new((0..count).rev()) }
}

/// XXH64 over all corners.
fn name_of(mesh: &Mesh<'_>) -> String {
    let mut state = Xxh64::new(0);
    for index in 0..mesh.len() {
        let bits: Vec<u32> =
            mesh.triangle(index).as_flattened().iter().map(|x| x.to_bits()).collect();
        state.write_words(&bits);
    }
    format!("{:016x}", state.finish())
}
