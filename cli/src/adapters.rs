//! `splitplane adapters`.

use super::ending::{self, TimeLimit};
use super::failure::Failure;
use clap::Args;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// Report as one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    time: TimeLimit,
}

/// Lists what there is; that there is nothing is no failure.
#[cfg(feature = "wgpu")]
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.time.begin();
    ending::check()?;
    list::print(arguments.json)
}

#[cfg(not(feature = "wgpu"))]
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.time.begin();
    ending::check()?;
    super::output::data(match arguments.json {
        true => "{\"adapters\":[]}\n",
        false => "this build of splitplane has no GPU backend\n",
    })
}

#[cfg(feature = "wgpu")]
mod list {
    use super::super::failure::Failure;
    use super::super::output;
    use super::super::prepared::print_json;
    use super::super::probe;
    use serde::Serialize;
    use splitplane::OpenOptions;
    use splitplane::backend::adapters_with;
    use splitplane::gpu::{AdapterReport, Parity};

    #[derive(Serialize)]
    struct Report {
        adapters: Vec<Adapter>,
    }

    #[derive(Serialize)]
    struct Adapter {
        index: usize,
        name: String,
        backend: &'static str,
        device_type: &'static str,
        driver: String,
        driver_info: String,
        max_storage_buffer_binding_size: u64,
        max_buffer_size: u64,
        max_storage_buffers_per_shader_stage: u32,
        max_compute_invocations_per_workgroup: u32,
        max_compute_workgroup_storage_size: u32,
        timestamps: bool,
        /// `bitwise`, `structural`, or nothing where the adapter cannot be used.
        parity: Option<&'static str>,
        /// What differs from the CPU where the parity is structural.
        difference: Option<String>,
        unusable: Option<String>,
    }

    impl From<AdapterReport> for Adapter {
        fn from(report: AdapterReport) -> Adapter {
            let limits = report.limits;
            Adapter {
                index: report.index,
                name: report.name,
                backend: report.backend,
                device_type: report.device_type,
                driver: report.driver,
                driver_info: report.driver_info,
                max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
                max_buffer_size: limits.max_buffer_size,
                max_storage_buffers_per_shader_stage: limits.max_storage_buffers_per_shader_stage,
                max_compute_invocations_per_workgroup: limits.max_compute_invocations_per_workgroup,
                max_compute_workgroup_storage_size: limits.max_compute_workgroup_storage_size,
                timestamps: report.timestamps,
                parity: report.parity.as_ref().map(Parity::name),
                difference: match report.parity {
                    Some(Parity::Structural(difference)) => Some(difference),
                    _ => None,
                },
                unusable: report.unusable,
            }
        }
    }

    impl Adapter {
        fn describe(&self) -> String {
            let parity = match (&self.unusable, self.parity, &self.difference) {
                (Some(reason), _, _) => format!("cannot be used: {reason}"),
                (None, Some(parity), Some(difference)) => format!("parity {parity}: {difference}"),
                (None, parity, _) => format!("parity {}", parity.unwrap_or("unknown")),
            };
            format!(
                "{}  {} ({}, {}; driver {} {})\n   \
                 {} bytes a storage buffer, {} bytes any buffer, {} storage buffers a kernel\n   \
                 {} invocations and {} bytes a workgroup, {} timestamps\n   \
                 {parity}\n",
                self.index,
                self.name,
                self.backend,
                self.device_type,
                self.driver,
                self.driver_info,
                self.max_storage_buffer_binding_size,
                self.max_buffer_size,
                self.max_storage_buffers_per_shader_stage,
                self.max_compute_invocations_per_workgroup,
                self.max_compute_workgroup_storage_size,
                if self.timestamps { "with" } else { "without" },
            )
        }
    }

    pub(super) fn print(json: bool) -> Result<(), Failure> {
        let reports = adapters_with(&probe::limited(OpenOptions::default()));
        let adapters: Vec<Adapter> = reports.into_iter().map(Adapter::from).collect();
        if json {
            return print_json(&Report { adapters });
        }
        if adapters.is_empty() {
            return output::data("no GPU adapter was found\n");
        }
        output::data(&adapters.iter().map(Adapter::describe).collect::<String>())
    }
}
