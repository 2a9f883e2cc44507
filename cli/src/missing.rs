//! Verbs that this build leaves out.

use std::ffi::OsString;

use clap::{Args, Subcommand};

use super::failure::Failure;

/// The verbs of features that are off.
#[derive(Subcommand)]
pub(super) enum Verb {
    #[cfg(not(feature = "measure"))]
    #[command(hide = true)]
    Paper(Anything),
    #[cfg(not(feature = "measure"))]
    #[command(hide = true)]
    Trade(Anything),
    #[cfg(not(feature = "viewer"))]
    #[command(hide = true)]
    View(Anything),
}

/// Whatever follows the verb.
#[derive(Args)]
#[command(disable_help_flag = true)]
pub(super) struct Anything {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, num_args = 0..)]
    rest: Vec<OsString>,
}

impl Verb {
    /// Says which feature the verb needs.
    pub(super) fn run(self) -> Result<(), Failure> {
        let (verb, feature, given) = match self {
            #[cfg(not(feature = "measure"))]
            Verb::Paper(Anything { rest }) => ("paper", "measure", rest),
            #[cfg(not(feature = "measure"))]
            Verb::Trade(Anything { rest }) => ("trade", "measure", rest),
            #[cfg(not(feature = "viewer"))]
            Verb::View(Anything { rest }) => ("view", "viewer", rest),
        };
        drop(given);
        Err(Failure::usage(format!(
            "this build has no verb `{verb}`: install with `--features {feature}`, or in a checkout run \
             `cargo run --release --features splitplane-cli/{feature} -- {verb}`"
        )))
    }
}
