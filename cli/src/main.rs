//! The program `splitplane`.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    splitplane_cli::main()
}
