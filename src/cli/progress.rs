//! Progress on standard error, where somebody watches.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::time::Duration;

/// A bar over this many rays; silent when standard error is not a terminal, or when asked to be.
pub(super) fn bar(quiet: bool, what: &'static str, rays: u64) -> ProgressBar {
    let bar = new(quiet, rays);
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent}% {eta}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message(what);
    bar
}

/// A sign of life for work of unknown length.
pub(super) fn spinner(quiet: bool, what: &'static str) -> ProgressBar {
    let bar = new(quiet, 0);
    bar.set_style(ProgressStyle::default_spinner());
    bar.set_message(what);
    if !bar.is_hidden() {
        bar.enable_steady_tick(Duration::from_millis(100));
    }
    bar
}

fn new(quiet: bool, length: u64) -> ProgressBar {
    if quiet || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    ProgressBar::new(length)
}
