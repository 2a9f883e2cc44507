//! The build schedule as its executor sees it, pinned.

use splitplane_core::backend::BuildError;
use splitplane_core::config::BuildConfig;
use splitplane_core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane_core::schedule::{Executor, Trace, build};
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuExecutor, InstructionSet};
use splitplane_test_support::scenes;

fn trace(triangles: usize) -> String {
    let scene = scenes::soup(triangles, 0.2, 11);
    let mesh = scene.mesh();
    let set = InstructionSet::detect();
    let executor: CpuExecutor<'_> =
        CpuExecutor::new(mesh, BuildConfig::default(), set, Buffers::default(), None).unwrap();
    let mut lines = String::new();
    let mut trace = Trace::new(executor, &mut lines);
    build(&mut trace).unwrap();
    lines
}

#[test]
fn the_schedule_of_a_small_scene() {
    insta::assert_snapshot!("one-level", trace(100));
}

#[test]
fn without_triangles_no_level_runs() {
    let lines = trace(0);
    assert!(!lines.contains("SplitLarge"), "{lines}");
    assert!(lines.contains("EmitTop"));
}

/// A level repeats the same eight kernels and two swaps, however many levels there are.
#[test]
fn levels_are_alike() {
    let lines = trace(5000);
    let levels = lines.matches("dispatch SplitLarge").count();
    assert!(levels > 5);
    for kernel in &Kernel::ALL[3..11] {
        assert_eq!(lines.matches(&format!("dispatch {kernel:?}\n")).count(), levels, "{kernel:?}");
    }
    assert_eq!(lines.matches("swap").count(), 2 * levels);
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
            return Err(BuildError::Device("planted".into()));
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
        let mut executor = Failing { at, ran: Vec::new() };
        assert!(build(&mut executor).is_err());
        assert!(!executor.ran.contains(&at));
        let before = Kernel::ALL.iter().position(|kernel| *kernel == at);
        assert!(executor.ran.len() >= before.unwrap_or(0));
    }
}
