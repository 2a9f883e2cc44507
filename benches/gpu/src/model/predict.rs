//! The time of a dispatch from four floors: its launch, its bytes, its instructions, its longest chain.

use super::devices::Device;
use super::shaders::Shader;
use crate::count::tally::{Counted, LANES_IN_STEP, Tally};

/// Milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Predicted {
    pub launch: f64,
    pub bytes: f64,
    pub instructions: f64,
    pub chain: f64,
    /// The launch and the greatest of the others, dispatch by dispatch.
    pub time: f64,
}

impl Predicted {
    fn add(&mut self, other: Predicted) {
        self.launch += other.launch;
        self.bytes += other.bytes;
        self.instructions += other.instructions;
        self.chain += other.chain;
        self.time += other.time;
    }

    /// The greatest floor, in a word.
    pub(crate) fn bound(&self) -> &'static str {
        let floors = [
            (self.launch, "launch"),
            (self.bytes, "bytes"),
            (self.instructions, "instructions"),
            (self.chain, "chain"),
        ];
        floors.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or("", |greatest| greatest.1)
    }

    /// Several kernels one after the other.
    pub(crate) fn sum(all: impl IntoIterator<Item = Predicted>) -> Predicted {
        let mut sum = Predicted::default();
        all.into_iter().for_each(|one| sum.add(one));
        sum
    }
}

/// Workgroups that fit into a multiprocessor at a time.
pub(crate) fn resident(device: &Device, shader: &Shader, lanes: u32) -> f64 {
    let warps = f64::from(lanes.div_ceil(LANES_IN_STEP));
    // Registers are given out by eight a lane.
    let registers = (shader.registers / 8.0).ceil() * 8.0 * 32.0 * warps;
    let by_warps = device.warps.number / warps;
    let by_registers = device.registers.number / registers.max(1.0);
    let by_shared = device.shared.number / shader.shared.max(1.0);
    let all = by_warps.min(by_registers).min(by_shared).min(device.workgroups.number);
    all.floor().max(1.0)
}

/// Workgroups and what they do.
#[derive(Clone, Copy, Debug)]
struct Work {
    workgroups: u64,
    operations: u64,
    loads: u64,
    in_step: u64,
}

/// Cycles that the instructions of workgroups take, spread over the device.
fn cycles(device: &Device, shader: &Shader, lanes: u32, work: Work) -> f64 {
    let all = work.workgroups.max(1) as f64;
    let at_work = all.min(device.multiprocessors.number);
    let groups = resident(device, shader, lanes).min((all / at_work).ceil());
    let rate = at_work * device.schedulers.number * issue(device, shader, work, lanes, groups).rate;
    work.in_step as f64 * shader.per_operation / rate
}

/// What a scheduler issues.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Issued {
    /// Loads an instruction.
    pub loads: f64,
    /// Cycles that a warp waits between two instructions.
    pub wait: f64,
    /// Warps of a scheduler.
    pub warps: f64,
    /// Instructions a cycle.
    pub rate: f64,
}

/// Instructions a cycle and scheduler, with this many workgroups at work on a multiprocessor: what its warps offer while
/// each waits for its last instruction or load, and no more than the scheduler takes.
fn issue(device: &Device, shader: &Shader, of: Work, lanes: u32, groups: f64) -> Issued {
    let instructions = of.operations as f64 * shader.per_operation;
    let loads = of.loads as f64 / instructions.max(1.0);
    let wait = device.step.number + loads * device.dependent.number * device.load.number;
    let warps = groups * f64::from(lanes.div_ceil(LANES_IN_STEP)) / device.schedulers.number;
    Issued { loads, wait, warps, rate: (warps / wait).min(device.issue.number) }
}

/// What a scheduler issues of a dispatch that fills the device.
pub(crate) fn issued(device: &Device, shader: &Shader, lanes: u32, of: &Tally) -> Issued {
    issue(device, shader, everyone(of), lanes, resident(device, shader, lanes))
}

fn everyone(of: &Tally) -> Work {
    Work {
        workgroups: of.workgroups,
        operations: of.operations,
        loads: of.loads,
        in_step: of.in_step,
    }
}

/// One dispatch.
pub(crate) fn dispatch(device: &Device, shader: &Shader, lanes: u32, of: &Tally) -> Predicted {
    let cycles_ms = 1e-6 / device.clock.number;
    // Those that have nothing to do are spread over the device too, and leave it to the others.
    let everyone = everyone(of);
    let busy = Work {
        workgroups: of.busy,
        operations: of.busy_operations,
        loads: of.busy_loads,
        in_step: of.busy_in_step,
    };
    let [everyone, busy] = [everyone, busy].map(|work| cycles(device, shader, lanes, work));
    let launch = device.dispatch.number * 1e-3;
    let bytes = of.bytes() as f64 / device.bandwidth.number * 1e-6;
    let instructions = everyone.max(busy) * cycles_ms;
    let chain = cycles_ms
        * (of.longest_operations as f64 * shader.per_operation * device.step.number
            + of.longest_loads as f64 * device.dependent.number * device.load.number
            + of.longest_barriers as f64 * device.barrier.number);
    Predicted {
        launch,
        bytes,
        instructions,
        chain,
        time: launch + bytes.max(instructions).max(chain),
    }
}

/// All dispatches of a kernel.
pub(crate) fn kernel(device: &Device, shader: &Shader, of: &Counted) -> Predicted {
    Predicted::sum(of.dispatches.iter().map(|one| dispatch(device, shader, of.lanes, one)))
}

/// Dispatches that have nothing to do.
pub(crate) fn empty(device: &Device, dispatches: u64) -> Predicted {
    let launch = dispatches as f64 * device.dispatch.number * 1e-3;
    Predicted { launch, time: launch, ..Predicted::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::devices::BY_HAND;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-9 * b.abs().max(1e-9)
    }

    /// 132 multiprocessors of 4 schedulers, 64 warps, 65,536 registers and 228 KiB; 3 us a dispatch.
    const DEVICE: &Device = &BY_HAND;

    #[test]
    fn workgroups_fit_by_what_is_scarce() {
        let of = |registers, shared| Shader { per_operation: 1.0, registers, shared, known: true };
        // 65,536 / (64 registers * 32 lanes * 2 warps) = 16.
        assert_eq!(resident(DEVICE, &of(64.0, 0.0), 64), 16.0);
        // 57 registers are given out as 64.
        assert_eq!(resident(DEVICE, &of(57.0, 0.0), 64), 16.0);
        // 64 warps / 8 = 8.
        assert_eq!(resident(DEVICE, &of(24.0, 0.0), 256), 8.0);
        // 233,472 / 50,000 = 4.67.
        assert_eq!(resident(DEVICE, &of(24.0, 50_000.0), 64), 4.0);
        // 32 is the most.
        assert_eq!(resident(DEVICE, &of(8.0, 0.0), 32), 32.0);
    }

    /// One workgroup of 256 lanes, 1,000 operations each in step, two instructions an operation, no load: 8 warps on 4
    /// schedulers, 2 warps every 4 cycles: 0.5 a cycle. 16,000 instructions at 4 * 0.5 = 8,000 cycles. The chain is
    /// 1,000 * 2 * 4 = 8,000 cycles too, and 10 barriers 300 more.
    #[test]
    fn one_workgroup_by_hand() {
        let shader = Shader { per_operation: 2.0, registers: 32.0, shared: 0.0, known: true };
        let of = Tally {
            dispatches: 1,
            workgroups: 1,
            busy: 1,
            operations: 256_000,
            in_step: 8_000,
            busy_operations: 256_000,
            busy_in_step: 8_000,
            longest_operations: 1_000,
            longest_barriers: 10,
            read: 4_300_000,
            ..Tally::default()
        };
        let found = dispatch(DEVICE, &shader, 256, &of);
        assert!(close(found.instructions, 8_000.0 / 1.755e6), "{found:?}");
        assert!(close(found.chain, 8_300.0 / 1.755e6), "{found:?}");
        // 4.3 MB at 4,300 GB/s.
        assert!(close(found.bytes, 1e-3), "{found:?}");
        assert!(close(found.time, 3e-3 + 8_300.0 / 1.755e6), "{found:?}");
        assert_eq!(found.bound(), "chain");
    }

    /// Full: 132 * 16 workgroups of 2 warps with 64 registers, 8 warps a scheduler. A load every 10 instructions, half of
    /// them waited for: each warp waits 4 + 270 / 20 = 17.5 cycles, 8 / 17.5 = 0.457 a cycle.
    #[test]
    fn a_full_device_by_hand() {
        let shader = Shader { per_operation: 1.0, registers: 64.0, shared: 0.0, known: true };
        let groups = 132 * 16;
        let of = Tally {
            dispatches: 1,
            workgroups: groups,
            busy: groups,
            operations: groups * 64 * 1_000,
            loads: groups * 64 * 100,
            in_step: groups * 2 * 1_000,
            busy_operations: groups * 64 * 1_000,
            busy_loads: groups * 64 * 100,
            busy_in_step: groups * 2 * 1_000,
            ..Tally::default()
        };
        let found = dispatch(DEVICE, &shader, 64, &of);
        let issue = 8.0 / 17.5;
        let cycles = (groups * 2_000) as f64 / (132.0 * 4.0 * issue);
        assert!(close(found.instructions, cycles / 1.755e6), "{found:?}");
        // With more warps than are needed the scheduler is what binds.
        let lean = Shader { registers: 16.0, ..shader };
        let of = Tally { busy: 2 * groups, workgroups: 2 * groups, ..of };
        let found = dispatch(DEVICE, &lean, 64, &of);
        assert!(close(found.instructions, (groups * 2_000) as f64 / (528.0 * 0.6) / 1.755e6));
    }

    /// 2,048 workgroups, one of which has something to do: 100 operations of each of its 64 lanes. The others, with one
    /// each, are spread over the device, and the busy one takes its time: 2 warps, half a warp a scheduler every 4 cycles.
    #[test]
    fn one_busy_workgroup_among_many_by_hand() {
        let shader = Shader { per_operation: 1.0, registers: 32.0, shared: 0.0, known: true };
        let of = Tally {
            dispatches: 1,
            workgroups: 2048,
            busy: 1,
            operations: 2047 * 64 + 6_400,
            in_step: 2047 * 2 + 200,
            busy_operations: 6_400,
            busy_in_step: 200,
            ..Tally::default()
        };
        let found = dispatch(DEVICE, &shader, 64, &of);
        assert!(close(found.instructions, 200.0 / (4.0 * 0.125) / 1.755e6), "{found:?}");
    }

    #[test]
    fn empty_dispatches_cost_their_launch() {
        let found = empty(DEVICE, 100);
        assert!(close(found.time, 0.3) && found.bound() == "launch");
    }
}
