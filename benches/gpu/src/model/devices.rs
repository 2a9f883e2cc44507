//! Devices by name, with public figures of theirs and what is assumed of them.

/// A number, and where it is from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Assumed {
    pub number: f64,
    pub source: &'static str,
}

/// The offline compiler whose figures of the shaders are taken for a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compiler {
    /// ptxas for sm_90.
    Cuda,
    /// Mesa's ACO for AMD.
    Aco,
}

/// A device. A *multiprocessor* is a streaming multiprocessor or a compute unit; 32 invocations in step are a *warp*.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Device {
    pub name: &'static str,
    /// Part of its name as an adapter.
    pub adapter: &'static str,
    pub compiler: Compiler,
    pub multiprocessors: Assumed,
    /// GHz.
    pub clock: Assumed,
    /// GB/s that copies reach.
    pub bandwidth: Assumed,
    /// Schedulers of a multiprocessor, each of which issues at most one instruction of a warp a cycle.
    pub schedulers: Assumed,
    /// Instructions a cycle and scheduler at best.
    pub issue: Assumed,
    /// Most warps and workgroups of a multiprocessor at a time.
    pub warps: Assumed,
    pub workgroups: Assumed,
    /// Registers of a lane, in all warps of a multiprocessor.
    pub registers: Assumed,
    /// Bytes of workgroup memory of a multiprocessor.
    pub shared: Assumed,
    /// Cycles until the next instruction of the same warp, without loads.
    pub step: Assumed,
    /// Cycles of a load from a buffer, mostly from the L2 cache.
    pub load: Assumed,
    /// The part of an invocation's loads that wait for one another.
    pub dependent: Assumed,
    /// Cycles of a barrier.
    pub barrier: Assumed,
    /// Microseconds from the start of a dispatch to that of the next, which waits for it.
    pub dispatch: Assumed,
}

const fn of(number: f64, source: &'static str) -> Assumed {
    Assumed { number, source }
}

const GUESS: &str = "assumed; nothing was measured";
const ESTIMATED: &str =
    "estimated on an H100, 160 to 190 KiB: docs/measurements/gpu-hardware-2026-11-26.md";
const MEASURED: &str = "measured on an H100: docs/measurements/gpu-hardware-2026-11-26.md";
const TUNING: &str = "NVIDIA, Hopper Tuning Guide: occupancy";
const ADA: &str = "NVIDIA, Ada GPU Architecture whitepaper";
const RDNA: &str = "AMD, RDNA 3 Instruction Set Architecture; HIP hardware table";

const H200: Device = Device {
    name: "h200",
    adapter: "H200",
    compiler: Compiler::Cuda,
    multiprocessors: of(132.0, "NVIDIA, H100 whitepaper: SXM5, the same chip"),
    clock: of(1.98, MEASURED),
    bandwidth: of(4300.0, "assumed: 90 % of the 4.8 TB/s of NVIDIA's H200 datasheet"),
    schedulers: of(4.0, TUNING),
    issue: of(0.43, MEASURED),
    warps: of(64.0, TUNING),
    workgroups: of(32.0, TUNING),
    registers: of(65_536.0, TUNING),
    shared: of(184_320.0, ESTIMATED),
    step: of(7.9, MEASURED),
    load: of(316.0, MEASURED),
    dependent: of(0.5, GUESS),
    barrier: of(46.0, MEASURED),
    dispatch: of(2.1, MEASURED),
};

/// All devices; the first is the default.
pub(crate) const DEVICES: [Device; 4] = [
    H200,
    Device { name: "h100", adapter: "H100", bandwidth: of(2973.0, MEASURED), ..H200 },
    Device {
        name: "rtx-4070-ti",
        adapter: "4070 Ti",
        compiler: Compiler::Cuda,
        multiprocessors: of(60.0, ADA),
        clock: of(2.61, "NVIDIA: boost clock"),
        bandwidth: of(450.0, "assumed: 90 % of NVIDIA's 504 GB/s"),
        schedulers: of(4.0, ADA),
        issue: of(0.6, GUESS),
        warps: of(48.0, ADA),
        workgroups: of(24.0, ADA),
        registers: of(65_536.0, ADA),
        shared: of(102_400.0, ADA),
        step: of(4.0, "assumed: 4 cycles of a dependent operation since Volta"),
        load: of(270.0, "assumed: as for the H200"),
        dependent: of(0.5, GUESS),
        barrier: of(30.0, GUESS),
        dispatch: of(3.0, GUESS),
    },
    Device {
        name: "radeon-780m",
        adapter: "780M",
        compiler: Compiler::Aco,
        multiprocessors: of(12.0, "AMD: Radeon 780M, compute units"),
        clock: of(2.7, "AMD: Ryzen 7 7840U, graphics frequency"),
        bandwidth: of(76.0, "assumed: 85 % of two channels of DDR5-5600, 89.6 GB/s"),
        schedulers: of(2.0, RDNA),
        issue: of(0.6, GUESS),
        warps: of(32.0, RDNA),
        workgroups: of(16.0, GUESS),
        registers: of(65_536.0, RDNA),
        shared: of(65_536.0, RDNA),
        step: of(5.0, "assumed: 5 cycles of a dependent operation on RDNA"),
        load: of(400.0, GUESS),
        dependent: of(0.5, GUESS),
        barrier: of(40.0, GUESS),
        dispatch: of(6.0, GUESS),
    },
];

/// Round numbers, for sums by hand.
#[cfg(test)]
pub(crate) const BY_HAND: Device = Device {
    clock: of(1.755, GUESS),
    issue: of(0.6, GUESS),
    shared: of(233_472.0, GUESS),
    step: of(4.0, GUESS),
    load: of(270.0, GUESS),
    barrier: of(30.0, GUESS),
    dispatch: of(3.0, GUESS),
    ..DEVICES[0]
};

/// A device by its name here, or by the name of an adapter.
pub(crate) fn find(name: &str) -> Option<&'static Device> {
    DEVICES.iter().find(|device| device.name == name || name.contains(device.adapter))
}

impl Device {
    /// What is assumed: name, number, source.
    pub(crate) fn assumptions(&self) -> [(&'static str, Assumed); 14] {
        [
            ("multiprocessors", self.multiprocessors),
            ("clock, GHz", self.clock),
            ("copies, GB/s", self.bandwidth),
            ("schedulers a multiprocessor", self.schedulers),
            ("instructions a cycle and scheduler, at best", self.issue),
            ("warps a multiprocessor, at most", self.warps),
            ("workgroups a multiprocessor, at most", self.workgroups),
            ("registers a multiprocessor", self.registers),
            ("workgroup memory a multiprocessor, bytes", self.shared),
            ("cycles to the next instruction of a warp", self.step),
            ("cycles of a load", self.load),
            ("part of the loads that wait for one another", self.dependent),
            ("cycles of a barrier", self.barrier),
            ("a dispatch that waits for the one before, us", self.dispatch),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_are_found_by_either_name() {
        assert_eq!(find("h200").unwrap().name, "h200");
        assert_eq!(find("NVIDIA H200").unwrap().name, "h200");
        assert_eq!(find("NVIDIA H100 80GB HBM3").unwrap().name, "h100");
        assert_eq!(find("AMD Radeon 780M Graphics (RADV PHOENIX)").unwrap().name, "radeon-780m");
        assert!(find("llvmpipe (LLVM 15.0.6, 256 bits)").is_none());
    }
}
