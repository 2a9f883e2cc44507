//! Options by their names.

use std::collections::BTreeMap;

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use splitplane::auto_preset::{self, Machine, MeshTraits};
use splitplane::{Accuracy, BuildConfig, Culling, Mesh, Preset, QueryLayout, QueryReport};

use crate::arrays::rows;
use crate::failure::Failure;

fn unknown(what: &str, name: &str, known: &str) -> Failure {
    Failure::new("ConfigError", format!("there is no {what} `{name}`; there are {known}"))
}

/// A preset, and changes to its knobs.
pub(crate) fn config(preset: &str, knobs: &BTreeMap<String, i64>) -> Result<BuildConfig, Failure> {
    let preset: Preset =
        preset.parse().map_err(|_| unknown("preset", preset, "fast, narrow, balanced and best"))?;
    let mut config = preset.config();
    for (name, &value) in knobs {
        let value = u32::try_from(value).map_err(|_| {
            Failure::new(
                "ConfigError",
                format!("{name} is {value}, but must be a whole number of 32 bits"),
            )
        })?;
        let place = match name.as_str() {
            "traversal_cost" => Some(&mut config.traversal_cost),
            "intersection_cost" => Some(&mut config.intersection_cost),
            "block_width" => Some(&mut config.block_width),
            "max_depth" => Some(&mut config.max_depth),
            "references_per_triangle" => Some(&mut config.references_per_triangle),
            "clip" => {
                config.clip = value != 0;
                continue;
            }
            "small_node_limit" => config.stages_mut().map(|stages| &mut stages.small_node_limit),
            "empty_cutoff" => config.stages_mut().map(|stages| &mut stages.empty_cutoff),
            "nodes_per_triangle" => {
                config.stages_mut().map(|stages| &mut stages.nodes_per_triangle)
            }
            "bins" => config.bins_mut(),
            "empty_bonus" => config.sweep_mut().map(|sweep| &mut sweep.empty_bonus),
            "bad_splits" => config.sweep_mut().map(|sweep| &mut sweep.bad_splits),
            _ => return Err(Failure::new("ConfigError", format!("there is no knob `{name}`"))),
        };
        let Some(place) = place else {
            let text = format!("the builder of preset {} has no knob `{name}`", preset.name());
            return Err(Failure::new("ConfigError", text));
        };
        *place = value;
    }
    config.validate().map_err(|error| {
        Failure::new("ConfigError", format!("the build configuration is invalid: {error}"))
    })?;
    Ok(config)
}

/// The preset that is expected to take the least time for a build over a mesh and so many rays, and why.
#[pyfunction]
pub(crate) fn choose_preset(
    vertices: PyReadonlyArray2<'_, f32>,
    faces: PyReadonlyArray2<'_, u32>,
    rays: u64,
    threads: Option<usize>,
) -> PyResult<(&'static str, String)> {
    let mesh = Mesh::indexed(rows(&vertices, "vertices")?, rows(&faces, "faces")?);
    let traits = MeshTraits::of(&mesh.map_err(Failure::from)?);
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let machine = Machine { threads: threads.unwrap_or_else(cores), ..Machine::here() };
    let choice = auto_preset::choose(&traits, rays, &machine);
    Ok((choice.preset.name(), choice.to_string()))
}

pub(crate) fn layout(name: &str) -> Result<QueryLayout, Failure> {
    let found = QueryLayout::ALL.into_iter().find(|layout| layout.name() == name);
    found.ok_or_else(|| unknown("layout", name, "fast and compact"))
}

pub(crate) fn accuracy(name: &str) -> Result<Accuracy, Failure> {
    name.parse().map_err(|_| unknown("accuracy", name, "fast, watertight and exact"))
}

pub(crate) fn culling(name: &str) -> Result<Culling, Failure> {
    match name {
        "none" => Ok(Culling::None),
        "back" => Ok(Culling::Back),
        "front" => Ok(Culling::Front),
        _ => Err(unknown("culling", name, "none, back and front")),
    }
}

/// Undecided, unfinished, answered by the CPU, placed by the CPU.
pub(crate) type Counts = (u64, u64, u64, u64);

/// A report as the Python part takes it.
pub(crate) fn counts(report: &QueryReport) -> Counts {
    (report.undecided, report.unfinished, report.answered_by_cpu, 0)
}

/// Adds what another part of a batch counted.
pub(crate) fn add(sum: &mut Counts, report: &QueryReport) {
    let (a, b, c, _) = counts(report);
    *sum = (sum.0 + a, sum.1 + b, sum.2 + c, sum.3);
}
