//! The build schedule as its executor sees it, pinned.

use splitplane_core::build::schedule::{Executor, Trace, build};
use splitplane_core::config::{Planes, Preset};
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuExecutor, InstructionSet};
use splitplane_test_support::scenes;

fn trace(triangles: usize, preset: Preset) -> String {
    let config = preset.config();
    let scene = scenes::soup(triangles, 0.2, 11);
    let mesh = scene.mesh();
    let set = InstructionSet::detect();
    let executor: CpuExecutor<'_> =
        CpuExecutor::new(mesh, config, set, Buffers::default(), None).unwrap();
    let mut lines = String::new();
    let mut trace = Trace::new(executor, &mut lines);
    build(&mut trace, config.preset().planes().unwrap()).unwrap();
    lines
}

#[test]
fn the_schedule_of_a_small_scene() {
    insta::assert_snapshot!("one-level", trace(100, Preset::Fast));
    insta::assert_snapshot!("one-level-binned", trace(100, Preset::Balanced));
}

#[test]
fn without_triangles_no_level_runs() {
    let lines = trace(0, Preset::Fast);
    assert!(!lines.contains("SplitMedian"), "{lines}");
    assert!(lines.contains("EmitTop"));
}

/// A level repeats the same kernels and two swaps, however many levels there are: four kernels, or
/// six where planes are found by bins.
#[test]
fn levels_are_alike() {
    for preset in [Preset::Fast, Preset::Balanced] {
        let lines = trace(5000, preset);
        let count = |kernel| lines.matches(&format!("dispatch {kernel:?}\n")).count();
        let levels = count(Kernel::ClassifyReferences);
        assert!(levels > 5);
        let mut kernels = 0;
        for &kernel in &Kernel::ALL[3..10] {
            let binned =
                matches!(kernel, Kernel::NodeBounds | Kernel::BinReferences | Kernel::SplitBinned);
            let runs = if kernel == Kernel::SplitMedian { preset == Preset::Fast } else { true }
                && (!binned || preset == Preset::Balanced);
            assert_eq!(count(kernel), if runs { levels } else { 0 }, "{kernel:?}");
            kernels += u32::from(runs);
        }
        assert_eq!(kernels, if preset == Preset::Fast { 4 } else { 6 });
        assert_eq!(lines.matches("swap").count(), 2 * levels);
    }
}

/// An executor that fails at one kernel: the error comes out, and nothing runs after it.
struct Failing {
    at: Kernel,
    ran: Vec<Kernel>,
}

impl Executor<TreeBuilder> for Failing {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        if kernel == self.at {
            return Err(BuildError::Device(DeviceError::Failed("planted".into())));
        }
        self.ran.push(kernel);
        Ok(())
    }

    fn swap(&mut self, _: Buffer, _: Buffer) -> Result<(), BuildError> {
        Ok(())
    }

    fn pending(&mut self, _: Counter, rounds: u32) -> Result<bool, BuildError> {
        Ok(rounds < 2)
    }
}

#[test]
fn a_failing_kernel_ends_the_build() {
    for at in Kernel::ALL {
        let binned = matches!(at, Kernel::NodeBounds | Kernel::BinReferences | Kernel::SplitBinned);
        let planes = if binned { Planes::Binned } else { Planes::Median };
        let mut executor = Failing { at, ran: Vec::new() };
        assert!(build(&mut executor, planes).is_err(), "{at:?}");
        // All that runs before it ran, and nothing after it.
        let mut all = Failing { at: Kernel::EmitSmall, ran: Vec::new() };
        assert!(build(&mut all, planes).is_err());
        assert!(all.ran.starts_with(&executor.ran));
        assert_eq!(all.ran.get(executor.ran.len()).copied().unwrap_or(at), at);
    }
}
