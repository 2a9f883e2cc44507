//! What a sweep tries: presets as they are, each knob by itself, accuracies, backends and threads.

use splitplane_core::backend::QueryLayout;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::ray::Accuracy;

/// Who builds and traces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// The cores of this machine.
    Cpu,
    /// A GPU.
    Gpu,
}

impl Device {
    /// The backend's name.
    pub const fn name(self) -> &'static str {
        match self {
            Device::Cpu => "cpu",
            Device::Gpu => "wgpu",
        }
    }
}

/// What is to be tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Scope {
    /// Presets, each as it is.
    pub presets: Vec<Preset>,
    /// Whether each preset is also tried with one knob off its value, for every knob.
    pub knobs: bool,
    /// Accuracies; every preset as it is is tried with all of them.
    pub accuracies: Vec<Accuracy>,
    /// Devices, the one with the knobs first.
    pub devices: Vec<Device>,
    /// Threads of the CPU, the number for knobs last.
    pub threads: Vec<usize>,
}

/// A tree that is built in every round, and the accuracies at which rays are traced through it.
#[derive(Clone, Debug, PartialEq)]
pub struct Station {
    /// Preset and knob in words.
    pub name: String,
    /// The knob that differs from the preset's, in words.
    pub knob: Option<String>,
    /// What shapes the tree.
    pub config: BuildConfig,
    /// How the copies that queries read are laid out.
    pub layout: QueryLayout,
    /// Who builds and traces.
    pub device: Device,
    /// Threads, on the CPU.
    pub threads: usize,
    /// A row each.
    pub accuracies: Vec<Accuracy>,
}

impl Station {
    /// Whether the answers of another station are its own too: the same tree on the same device, at
    /// the same accuracies.
    pub fn answers_as(&self, other: &Station) -> bool {
        self.config == other.config
            && self.layout == other.layout
            && self.device == other.device
            && self.accuracies == other.accuracies
    }
}

/// All of it, in the order of the rows: by device, presets as in `Preset::ALL`, the preset as it is first,
/// then its knobs. Knobs are turned at one accuracy, on the first device and on the most threads:
/// one at a time around each preset, not all combinations.
pub fn stations(scope: &Scope) -> Vec<Station> {
    let mut stations = Vec::new();
    let most = scope.threads.last().copied().unwrap_or(1);
    let usual = usual_accuracy(&scope.accuracies);
    for (place, &device) in scope.devices.iter().enumerate() {
        for &preset in &scope.presets {
            // `best` is built on the CPU only.
            if device == Device::Gpu && preset.planes().is_none() {
                continue;
            }
            // `narrow` is `fast` for a GPU's rays: on the CPU only where it is among those asked for.
            let all = scope.presets.len() == Preset::ALL.len();
            if device == Device::Cpu && preset == Preset::Narrow && all {
                continue;
            }
            let config = preset.config();
            let station = |knob: Option<String>, config, layout, threads, accuracies| {
                let name = match &knob {
                    Some(knob) => format!("{}, {knob}", preset.name()),
                    None => preset.name().to_owned(),
                };
                Station { name, knob, config, layout, device, threads, accuracies }
            };
            let usually = QueryLayout::Fast;
            stations.push(station(None, config, usually, most, scope.accuracies.clone()));
            if device == Device::Cpu {
                for &threads in scope.threads.iter().rev().skip(1) {
                    stations.push(station(
                        None,
                        config,
                        usually,
                        threads,
                        scope.accuracies.clone(),
                    ));
                }
            }
            let turned = if scope.knobs && place == 0 { knobs(preset) } else { Vec::new() };
            for (knob, config) in turned {
                let usual = usual.into_iter().collect();
                stations.push(station(Some(knob), config, usually, most, usual));
            }
            // The GPU has one layout.
            if scope.knobs && device == Device::Cpu {
                for layout in QueryLayout::ALL.into_iter().filter(|layout| *layout != usually) {
                    let knob = format!("{} layout", layout.name());
                    let usual = usual.into_iter().collect();
                    stations.push(station(Some(knob), config, layout, most, usual));
                }
            }
        }
    }
    stations
}

/// The accuracy of rows about knobs: watertight, or what comes nearest.
fn usual_accuracy(accuracies: &[Accuracy]) -> Option<Accuracy> {
    let watertight = accuracies.iter().find(|&&accuracy| accuracy == Accuracy::Watertight);
    watertight.or(accuracies.first()).copied()
}

/// One knob off a preset's value, for every knob that the preset has.
pub fn knobs(preset: Preset) -> Vec<(String, BuildConfig)> {
    let own = preset.config();
    let staged = preset.planes().is_some();
    let mut out = Vec::new();
    let ratio =
        |k_i: u32| (format!("K_T/K_I 1/{k_i}"), BuildConfig { intersection_cost: k_i, ..own });
    // Half of 1 is none.
    let ratios = [own.intersection_cost / 2, own.intersection_cost * 2];
    out.extend(ratios.into_iter().filter(|&k_i| k_i > 0).map(ratio));
    if staged {
        for (words, empty_cutoff) in [("C_e 12.5 %", 32), ("C_e 50 %", 128)] {
            out.push((
                words.to_owned(),
                own.with_stages(|stages| stages.empty_cutoff = empty_cutoff),
            ));
        }
        out.push(("T 32".to_owned(), own.with_stages(|stages| stages.small_node_limit = 32)));
    }
    if preset == Preset::Balanced {
        out.extend([16, 64].map(|bins| (format!("{bins} bins"), own.with_bins(bins))));
    }
    if own.block_width != 1 {
        out.push(("W 1".to_owned(), BuildConfig { block_width: 1, ..own }));
    }
    let max_depth = own.max_depth / 2;
    out.push((format!("depth {max_depth}"), BuildConfig { max_depth, ..own }));
    out.push(("no clip".to_owned(), BuildConfig { clip: false, ..own }));
    let cap = BuildConfig { references_per_triangle: 2, ..own };
    out.push(("reference cap 2".to_owned(), cap));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scope() -> Scope {
        Scope {
            presets: Preset::ALL.to_vec(),
            knobs: true,
            accuracies: Accuracy::ALL.to_vec(),
            devices: vec![Device::Cpu, Device::Gpu],
            threads: vec![1, 4],
        }
    }

    #[test]
    fn every_knob_is_turned_alone_and_is_valid() {
        for preset in Preset::ALL {
            let own = preset.config();
            for (name, config) in knobs(preset) {
                assert_eq!(config.validate(), Ok(()), "{name}");
                let differing =
                    config.words().iter().zip(own.words()).filter(|(a, b)| **a != *b).count();
                assert_eq!(differing, 1, "{preset:?}, {name}: a knob that shapes the tree, alone");
            }
        }
    }

    #[test]
    fn no_setting_is_tried_twice_and_best_not_on_a_device() {
        let stations = stations(&scope());
        for (i, a) in stations.iter().enumerate() {
            let same = |b: &Station| a.answers_as(b) && a.threads == b.threads;
            assert_eq!(stations[..i].iter().filter(|b| same(b)).count(), 0, "{}", a.name);
            assert_eq!(a.accuracies.len(), if a.knob.is_some() { 1 } else { 3 });
            assert!(a.device == Device::Cpu || a.config.preset() != Preset::Best);
            assert!(a.device == Device::Gpu || a.config.preset() != Preset::Narrow);
            assert!(a.knob.is_none() || a.threads == 4);
        }
        let plain = stations.iter().filter(|station| station.knob.is_none()).count();
        assert_eq!(
            plain,
            3 * 2 + 3,
            "presets by threads, and two of them on the GPU with `narrow`"
        );
        assert_eq!(stations.len() - plain, 9 + 11 + 6 + 3, "knobs, and a layout each");
        let rows: usize = stations.iter().map(|station| station.accuracies.len()).sum();
        assert!(rows < 60, "{rows} rows are no table to read");
    }
}
