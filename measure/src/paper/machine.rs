//! What the figures of a report were taken on.

pub use super::builders::Knobs;
use serde::Serialize;
use splitplane_core::report::BackendInfo;

/// The machine, the program and how it was called.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Machine {
    /// Version of splitplane.
    pub version: &'static str,
    /// The command.
    pub command: String,
    /// Operating system and architecture.
    pub system: String,
    /// The processor, where the system tells its name.
    pub processor: Option<String>,
    /// Processors that this process may use.
    pub processors: usize,
    /// Threads used.
    pub threads: usize,
    /// The instruction set of the CPU's triangle test.
    pub instruction_set: String,
    /// The GPU.
    pub adapter: Option<String>,
    /// Its interface, driver and parity.
    pub adapter_detail: Option<String>,
    /// Why it is used, or none is.
    pub backend_reason: String,
    /// Whether the program was compiled for debugging: its times then mean nothing.
    pub debug_build: bool,
}

impl Machine {
    /// This machine. `threads` are those used; backends as they describe themselves.
    pub fn of(
        command: String,
        threads: usize,
        cpu: &BackendInfo,
        gpu: Option<&BackendInfo>,
        backend_reason: String,
    ) -> Machine {
        Machine {
            version: env!("CARGO_PKG_VERSION"),
            command,
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            processor: processor(),
            processors: std::thread::available_parallelism().map_or(1, usize::from),
            threads,
            instruction_set: cpu.detail.clone(),
            adapter: gpu.and_then(|info| info.adapter.clone()),
            adapter_detail: gpu.map(|info| info.detail.clone()),
            backend_reason,
            debug_build: cfg!(debug_assertions),
        }
    }

    /// All of it as lines of Markdown.
    pub fn markdown(&self) -> String {
        let mut out = format!(
            "- splitplane {}, called as `{}`\n- {}, {}, {} processors, {} used, {}\n",
            self.version,
            self.command,
            self.system,
            self.processor.as_deref().unwrap_or("processor not known"),
            self.processors,
            self.threads,
            self.instruction_set
        );
        out += &match (&self.adapter, &self.adapter_detail) {
            (Some(adapter), Some(detail)) => {
                format!("- GPU: {adapter} ({detail}; {})\n", self.backend_reason)
            }
            _ => format!("- no GPU is measured ({})\n", self.backend_reason),
        };
        if self.debug_build {
            out += "- **a debug build: the times mean nothing**\n";
        }
        out
    }
}

/// The processor's name where Linux tells it.
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
