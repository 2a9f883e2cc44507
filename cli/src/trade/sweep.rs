//! What is measured: settings, and the GPU that some of them are measured on.

use super::Arguments;
use crate::failure::Failure;
use crate::options::PresetName;
use splitplane::{Accuracy, Backend, BackendKind, OpenOptions, Preset};
use splitplane_measure::trade::compare::Old;
use splitplane_measure::trade::plan::{Device, Scope, Station, stations};

/// What is measured, on which GPU if on one, and why.
pub(super) struct Sweep {
    pub(super) stations: Vec<Station>,
    pub(super) gpu: Gpu,
}

/// The GPU that is measured, if one is, and why.
pub(super) struct Gpu {
    pub(super) backend: Option<Box<dyn Backend>>,
    pub(super) reason: String,
}

impl Arguments {
    pub(super) fn sweep(&self) -> Result<Sweep, Failure> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let most = self.threads.map_or(cores, usize::from);
        let threads = if most > 1 { vec![1, most] } else { vec![1] };
        let on_cpu = self.backends.iter().any(|kind| *kind != BackendKind::Wgpu);
        if !on_cpu && self.presets.iter().all(|builder| *builder == PresetName::Best) {
            return Err(Failure::usage(
                "preset best is built on the CPU only; add cpu to --backend",
            ));
        }
        let gpu = self.gpu()?;
        let mut devices = Vec::new();
        if on_cpu {
            devices.push(Device::Cpu);
        }
        if gpu.backend.is_some() {
            devices.push(Device::Gpu);
        }
        let mut presets: Vec<Preset> = self.presets.iter().map(|name| name.preset()).collect();
        presets.sort_by_key(|preset| *preset as u32);
        presets.dedup();
        let mut accuracies: Vec<Accuracy> =
            self.accuracies.iter().map(|level| level.accuracy()).collect();
        let rank = |accuracy: &Accuracy| Accuracy::ALL.iter().position(|own| own == accuracy);
        accuracies.sort_by_key(rank);
        accuracies.dedup();
        let scope = Scope { presets, knobs: !self.no_knobs, accuracies, devices, threads };
        Ok(Sweep { stations: stations(&scope), gpu })
    }

    /// What a file says was measured.
    pub(super) fn sweep_again(&self, old: &Old) -> Result<Sweep, Failure> {
        let stations = old.stations();
        let gpu = match stations.iter().any(|station| station.device == Device::Gpu) {
            true => self.open_gpu(BackendKind::Wgpu)?,
            false => Gpu { backend: None, reason: "none, as in the file".into() },
        };
        Ok(Sweep { stations, gpu })
    }

    /// The GPU to measure. It is opened before the scene is: that there is none is said first.
    fn gpu(&self) -> Result<Gpu, Failure> {
        let kinds = &self.backends;
        if kinds.contains(&BackendKind::Wgpu) {
            return self.open_gpu(BackendKind::Wgpu);
        }
        let none = |reason: &str| Ok(Gpu { backend: None, reason: reason.to_owned() });
        if !kinds.contains(&BackendKind::Auto) {
            return none("none, since only the CPU was asked for");
        }
        if self.quick && self.adapter.is_none() {
            return none("auto: none, since --quick was given");
        }
        self.open_gpu(BackendKind::Auto)
    }

    fn open_gpu(&self, kind: BackendKind) -> Result<Gpu, Failure> {
        let opened = kind.open_with(&self.open_options())?;
        let is_gpu = opened.backend.describe().name != "cpu";
        Ok(Gpu { backend: is_gpu.then_some(opened.backend), reason: opened.reason })
    }

    fn open_options(&self) -> OpenOptions {
        crate::probe::limited(OpenOptions {
            adapter: self.adapter.clone(),
            allow_structural: self.allow_structural,
            ..OpenOptions::default()
        })
    }
}
