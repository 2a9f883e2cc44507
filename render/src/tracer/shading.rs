//! Where a frame is shaded.

use core::fmt;

/// Where a frame is shaded, and where its rays are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Shading {
    /// All of it on the CPU.
    Cpu,
    /// All of it on the GPU.
    Gpu,
    /// Shaded on the CPU; rays, and photons near points, are found on the GPU, in batches: frames with light by paths or photons, of several
    /// passes, with an environment map, or of many objects.
    CpuWithRaysOnGpu,
}

impl Shading {
    /// In words, with the name of the GPU.
    pub fn describe(self, adapter: Option<&str>) -> String {
        let gpu = adapter.unwrap_or("the GPU");
        match self {
            Shading::Cpu => "all on the CPU".into(),
            Shading::Gpu => format!("all on {gpu}"),
            Shading::CpuWithRaysOnGpu => format!("shaded on the CPU, rays on {gpu}"),
        }
    }
}

impl fmt::Display for Shading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Shading::Cpu => "cpu",
            Shading::Gpu => "gpu",
            Shading::CpuWithRaysOnGpu => "cpu, rays on gpu",
        })
    }
}
