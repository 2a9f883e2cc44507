//! Surfaces, one after the other.

use crate::Problem;
use crate::options::Options;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::ray::Hit;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::grazing::{Shape, Surface, Volley};
use splitplane_test_support::surfaces::{
    Asked, OneLeaf, QueryMode, Tally, ask, compare, judge, seed_of, volleys,
};
use splitplane_wgpu::{Gpu, OpenOptions, Queries, WgpuAccelerator};
use std::fmt;
use std::sync::Arc;
use std::time::Instant;

/// The instruction sets of this processor, worst first.
pub(crate) fn sets() -> Vec<InstructionSet> {
    InstructionSet::available()
}

/// The device that `--gpu` names, with default limits.
///
/// # Errors
/// There is none, or it cannot be opened.
pub(crate) fn device(adapter: &str) -> Result<Arc<Queries>, Problem> {
    let options = OpenOptions {
        default_limits: true,
        adapter: Some(adapter.to_owned()),
        ..OpenOptions::default()
    };
    Ok(Arc::new(Queries::new(Arc::new(Gpu::open(&options)?))))
}

/// Seconds by what they were spent on.
#[derive(Clone, Copy, Default)]
pub(crate) struct Spent {
    making: f64,
    expecting: f64,
    building: f64,
    asking: f64,
}

impl Spent {
    /// Adds another thread's.
    pub(crate) fn add(&mut self, other: &Spent) {
        self.making += other.making;
        self.expecting += other.expecting;
        self.building += other.building;
        self.asking += other.asking;
    }
}

impl fmt::Display for Spent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Spent { making, expecting, building, asking } = self;
        write!(
            f,
            "seconds: {making:.1} for surfaces and rays, {expecting:.1} for expected answers and their checks, \
             {building:.1} for trees, {asking:.1} for answers"
        )
    }
}

/// One of the ways to make a tree for queries.
struct Configuration {
    /// Index of the backend.
    backend: usize,
    options: BuildOptions<'static>,
    name: [String; 3],
}

/// What a thread keeps from surface to surface.
pub(crate) struct Worker<'a> {
    options: &'a Options,
    /// One an instruction set.
    backends: Vec<CpuBackend>,
    configurations: Vec<Configuration>,
    /// Asked in place of the configurations.
    device: Option<Arc<Queries>>,
    /// Where time went.
    pub spent: Spent,
}

impl<'a> Worker<'a> {
    /// Makes the backends.
    pub(crate) fn new(options: &'a Options, device: Option<Arc<Queries>>) -> Worker<'a> {
        let mut configurations = Vec::new();
        for (backend, set) in sets().into_iter().enumerate() {
            for layout in [QueryLayout::Fast, QueryLayout::Compact] {
                // Presets next to each other, so that neighbours have other trees.
                for preset in Preset::ALL {
                    let config = preset.config();
                    let name = [
                        format!("preset {}", preset.name()),
                        format!("layout {}", layout.name()),
                        format!("set {}", set.name()),
                    ];
                    let options = BuildOptions { layout, ..BuildOptions::from(config) };
                    configurations.push(Configuration { backend, options, name });
                }
            }
        }
        let backends = sets().into_iter().map(CpuBackend::with_instruction_set).collect();
        Worker { options, backends, configurations, device, spent: Spent::default() }
    }

    /// All of one surface.
    ///
    /// # Errors
    /// A tree that cannot be built.
    pub(crate) fn surface(&mut self, number: u64) -> Result<Tally, Problem> {
        let mut time = Instant::now();
        let mut lap = |spent: &mut f64| {
            let now = Instant::now();
            *spent += (now - time).as_secs_f64();
            time = now;
        };
        let shape = Shape::ALL[number as usize % Shape::ALL.len()];
        let surface = Surface::new(shape, seed_of(self.options.seed, number));
        let volleys = volleys(&surface, self.options.each as usize);
        lap(&mut self.spent.making);

        let mesh = surface.scene.mesh();
        let triangles = surface.scene.triangles();
        let reference = OneLeaf::new(&mesh);
        let best = self.backends.last().ok_or("no instruction set")?;
        let one_leaf = best.load(&mesh, reference.tree.clone(), &LoadOptions::default())?;
        let mut tally = Tally { surfaces: 1, ..Tally::default() };
        let mut all_expected = Vec::new();
        for volley in &volleys {
            let expected = ask(&*one_leaf, &volley.rays, &volley.options, QueryMode::Together, 0);
            tally.add(judge(&surface, &triangles, volley, &expected));
            tally.add(self.sample(&surface, volley, &reference, &*one_leaf));
            all_expected.push(expected);
        }
        lap(&mut self.spent.expecting);

        if let Some(queries) = self.device.clone() {
            let preset = Preset::ALL[number as usize % Preset::ALL.len()];
            let config = BuildOptions::from(preset.config());
            let built = best.build_accelerator(&mesh, &config)?;
            let (tree, summary) = (built.tree().clone(), *built.summary());
            let corners: Vec<Triangle> =
                (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
            let device = WgpuAccelerator::upload(queries, tree, corners, summary)?;
            lap(&mut self.spent.building);
            let name = [format!("preset {}", preset.name()), "wgpu".to_owned()];
            let ways = [QueryMode::Together, QueryMode::AnyTogether];
            let asked = [Asked { name: &name, accelerator: &device, ways: &ways }];
            for (volley, expected) in volleys.iter().zip(&all_expected) {
                tally.add(compare(&surface, volley, expected, &asked));
            }
            lap(&mut self.spent.asking);
            return Ok(tally);
        }
        let count = self.configurations.len() as u64;
        let turns = u64::from(self.options.configurations).min(count);
        for turn in number * turns..(number + 1) * turns {
            let configuration = &self.configurations[(turn % count) as usize];
            let backend = &self.backends[configuration.backend];
            let accelerator = backend.build_accelerator(&mesh, &configuration.options)?;
            lap(&mut self.spent.building);
            // One more once all configurations have had their turn.
            let way = ((turn + turn / count) % 3) as usize;
            let ways =
                [QueryMode::CLOSEST[way], QueryMode::ANY[(way + (turn / count / 3) as usize) % 3]];
            let asked =
                [Asked { name: &configuration.name, accelerator: &accelerator, ways: &ways }];
            for (volley, expected) in volleys.iter().zip(&all_expected) {
                tally.add(compare(&surface, volley, expected, &asked));
            }
            lap(&mut self.spent.asking);
        }
        Ok(tally)
    }

    /// Some rays by the reference traversal over one leaf, and the same of the backend's one leaf.
    fn sample(
        &self,
        surface: &Surface,
        volley: &Volley,
        reference: &OneLeaf,
        one_leaf: &dyn Accelerator,
    ) -> Tally {
        let rays = volley.rays.iter().copied().step_by(self.options.sample as usize).collect();
        let sample = Volley { rays, ..volley.clone() };
        let expected: Vec<Hit> = reference.closest(&sample.rays, &sample.options);
        let name = ["one leaf".to_owned()];
        let ways = [QueryMode::Together, QueryMode::AnyTogether];
        let asked = [Asked { name: &name, accelerator: one_leaf, ways: &ways }];
        compare(surface, &sample, &expected, &asked)
    }
}
