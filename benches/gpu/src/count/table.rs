//! The counts of a build as a table.

use std::fmt::Write as _;

use super::build::CountedBuild;
use super::tally::Tally;

/// By kernel, and all together; behind it what a rebuild asks of the device.
pub(crate) fn table(build: &CountedBuild) -> String {
    let mut out = String::from(
        "| kernel | dispatches | workgroups | busy | barriers | read, KiB | written, KiB | rounds | longest chain |\n\
         |---|--:|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    let mut row = |name: &str, of: &Tally| {
        let kib = |bytes: u64| format!("{:.1}", bytes as f64 / 1024.0);
        let _ = writeln!(
            out,
            "| {name} | {} | {} | {} | {} | {} | {} | {} | {} |",
            of.dispatches,
            of.workgroups,
            of.busy,
            of.barriers,
            kib(of.read),
            kib(of.written),
            of.rounds,
            of.longest_rounds,
        );
    };
    for kernel in &build.kernels {
        row(kernel.kernel, &kernel.all());
    }
    row("all", &build.all());
    let rebuild = &build.rebuild;
    let _ = writeln!(
        out,
        "\nA rebuild: {} dispatches in {} submissions, {} round trips of the host.",
        rebuild.dispatches, rebuild.submissions, rebuild.readbacks
    );
    out
}
