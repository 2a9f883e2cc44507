//! How the program keeps drivers within limits: it starts itself once more to try those it does not know.

use super::failure::Failure;
use clap::Args;
use splitplane::OpenOptions;
use std::env;
use std::ffi::OsString;
use std::time::Duration;

/// The hidden verb of the second process.
pub(super) const VERB: &str = "__probe";

/// Seconds that a driver may take, for those that need more.
const SECONDS: &str = "SPLITPLANE_DRIVER_SECONDS";

#[derive(Args, Debug)]
pub(super) struct Arguments {
    #[arg(allow_hyphen_values = true, trailing_var_arg = true)]
    #[cfg_attr(not(feature = "wgpu"), allow(dead_code, reason = "there is no GPU to try"))]
    asked: Vec<OsString>,
}

#[cfg(feature = "wgpu")]
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    splitplane::backend::answer_probe(&arguments.asked, &mut std::io::stdout())
        .map_err(|error| Failure::usage(error.to_string()))
}

#[cfg(not(feature = "wgpu"))]
pub(super) fn run(_: &Arguments) -> Result<(), Failure> {
    Err(splitplane::OpenError::NoGpuBackend.into())
}

/// The same options with this program's limits on drivers.
pub(super) fn limited(options: OpenOptions) -> OpenOptions {
    OpenOptions {
        driver_time: seconds().ok().flatten(),
        #[cfg(feature = "wgpu")]
        probe: env::current_exe()
            .ok()
            .map(|program| splitplane::backend::Probe { program, arguments: vec![VERB.into()] }),
        ..options
    }
}

/// Says whether the environment makes sense, before any work.
///
/// # Errors
/// Wrong usage.
pub(super) fn check() -> Result<(), Failure> {
    seconds().map(drop)
}

fn seconds() -> Result<Option<Duration>, Failure> {
    let Some(text) = env::var_os(SECONDS).filter(|text| !text.is_empty()) else { return Ok(None) };
    let seconds = text.to_str().and_then(|text| text.parse().ok()).map(Duration::from_secs);
    let wrong = || Failure::usage(format!("{SECONDS} must be a whole number of seconds"));
    seconds.map(Some).ok_or_else(wrong)
}
