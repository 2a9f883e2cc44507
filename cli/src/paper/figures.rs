//! The figures of a report, drawn with its progress.

use super::{Arguments, Progress};
use crate::failure::Failure;
use splitplane::CpuBackend;
use splitplane_measure::paper::figures::{self, Figures};
use splitplane_measure::paper::objects::Objects;
use splitplane_measure::paper::scaling::{self, Scaling};
use splitplane_measure::paper::scene::{Placed, Settings};
use splitplane_measure::paper::survey::{SCALING_LARGEST, SCALING_SMALLEST};
use splitplane_measure::paper::{areas, pool};

/// Figures, and what some of them show.
pub(super) struct Drawn {
    pub(super) figures: Figures,
    pub(super) areas: areas::Areas,
    pub(super) objects: Option<Objects>,
}

impl Arguments {
    pub(super) fn figures(
        &self,
        placed: &[Placed],
        settings: &Settings,
        scalings: &[Scaling],
        progress: &Progress,
    ) -> Result<Drawn, Failure> {
        let mut trees = Vec::new();
        for placed in placed {
            trees.push(figures::tree(placed, settings)?);
            progress.step(&format!("{}: tree for figures", placed.scene.name));
        }
        let mut figures = Figures::default();
        let (boxes, lines) = if self.quick { (32, 4_000) } else { (96, 100_000) };
        let (first, tree) = (&placed[0], &trees[0]);
        let count = || areas::count(&tree.view(), &CpuBackend::new(), boxes, lines);
        let areas = pool(settings.threads)?.install(count)?;
        figures.point_trees()?;
        figures.tree(placed, &trees)?;
        let objects = figures.objects(placed, &trees)?;
        figures.areas(&first.scene.name, &areas)?;
        progress.step("figures 3 to 9");
        figures.cut(placed, &trees)?;
        progress.step("figure 10");
        for (letter, placed) in ('a'..='z').zip(placed) {
            figures.picture(letter, placed, if self.quick { 1 } else { 4 }, settings)?;
            progress.step(&format!("figure 11 {letter}"));
        }
        let (cpu, gpu): (Vec<Scaling>, Vec<Scaling>) =
            scalings.iter().cloned().partition(|scaling| scaling.backend == "cpu");
        for (name, scalings) in [("figure-12", cpu), ("figure-12-gpu", gpu)] {
            if !scalings.is_empty() {
                figures.scaling(name, &scalings)?;
            }
        }
        Ok(Drawn { figures, areas, objects })
    }
}

/// Figure 12 of the smallest and the largest scene, on every backend.
pub(super) fn scalings(
    placed: &[Placed],
    settings: &Settings,
    gpu: bool,
    progress: &Progress,
) -> Result<Vec<Scaling>, Failure> {
    let size = |placed: &&Placed| placed.scene.indices.len();
    let mut chosen: Vec<(&Placed, f64)> = placed
        .iter()
        .max_by_key(size)
        .map(|largest| (largest, SCALING_LARGEST))
        .into_iter()
        .collect();
    if placed.len() > 1 {
        chosen.extend(placed.iter().min_by_key(size).map(|smallest| (smallest, SCALING_SMALLEST)));
    }
    let mut scalings = Vec::new();
    for &(placed, printed) in &chosen {
        scalings.push(scaling::on_cpu(&placed.scene, printed, settings)?);
    }
    progress.step("figure 12");
    if gpu {
        #[cfg(feature = "wgpu")]
        for &(placed, printed) in &chosen {
            scalings.push(scaling::on_gpu(&placed.scene, printed, settings)?);
        }
        progress.step("figure 12 on the GPU");
    }
    Ok(scalings)
}
