//! What builds and traces: backends, pools of threads, and what preset `fast` takes on them.

use super::Settings;
use super::trace::trace;
use crate::paper::pool;
use crate::paper::timing::timed;
use crate::trade::TradeError;
use crate::trade::budget::{Budget, Pilot};
use crate::trade::hierarchy::Beside;
use crate::trade::plan::{Device, Station};
use crate::trade::rays::RaySets;
use crate::trade::rounds::mean;
use crate::trade::row::Sets;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::BuildConfig;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Accuracy;
use splitplane_core::watch::Watch;
use splitplane_cpu::CpuBackend;
use std::collections::{HashMap, hash_map};

/// What all stations share.
pub(super) struct Bench<'a> {
    pub(super) mesh: &'a Mesh<'a>,
    pub(super) cpu: CpuBackend,
    pub(super) gpu: Option<&'a dyn Backend>,
    pub(super) pools: HashMap<usize, rayon::ThreadPool>,
    /// The pool with most threads, for all that is not timed.
    pub(super) all: rayon::ThreadPool,
    pub(super) max_memory: Option<u64>,
    pub(super) watch: &'a dyn Watch,
}

impl<'a> Bench<'a> {
    pub(super) fn open(
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

    pub(super) fn build(
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
    pub(super) fn build_fast(&self, device: Device) -> Result<Box<dyn Accelerator>, TradeError> {
        self.build(device, "fast", &BuildConfig::default(), QueryLayout::Fast)
    }

    /// The hierarchy, where one is asked for and trees are measured on all threads of the CPU.
    pub(super) fn beside(
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

    pub(super) fn pool(&self, station: &Station) -> &rayon::ThreadPool {
        self.pools.get(&station.threads).unwrap_or(&self.all)
    }

    /// What preset `fast` takes on the CPU and on the GPU.
    pub(super) fn pilots(&self, sets: &RaySets) -> Result<[Pilot; 2], TradeError> {
        let pilot = |device: Device| {
            self.all.install(|| {
                let (tree, mut build_ms) = timed(|| self.build_fast(device));
                let tree = tree?;
                let mut ns_per_ray = [0.0; 3];
                // The first time warms up.
                for _ in 0..2 {
                    for (ns, accuracy) in ns_per_ray.iter_mut().zip(Accuracy::ALL) {
                        let mut own = Vec::new();
                        for (set, rays) in sets.each().into_iter().enumerate() {
                            let any = set == Sets::<()>::SHADOW;
                            let (ms, rays) = trace(tree.as_ref(), rays, any, accuracy, self.watch)?;
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
