//! Progress on standard error, where somebody watches.

use super::ending;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use splitplane::{Progress, Stage, Watch};
use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::time::Duration;

/// A bar over this many rays; silent when standard error is not a terminal, or when asked to be.
pub(super) fn bar(quiet: bool, what: &'static str, rays: u64) -> ProgressBar {
    let bar = new(quiet, rays);
    bar.set_style(bar_style());
    bar.set_message(what);
    ending::doing(what, &bar);
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
    ending::doing(what, &bar);
    bar
}

/// A bar that follows work, stage by stage, and ends it when the run is to end.
pub(super) fn watch(quiet: bool) -> Watching {
    let bar = new(quiet, 0);
    bar.set_style(bar_style());
    Watching { bar, stage: Mutex::new(None) }
}

/// Ends work when the run is to end, and shows nothing: for work in many steps that has a bar of its own.
pub(super) struct Unseen;

impl Watch for Unseen {
    fn progress(&self, _progress: &Progress) -> ControlFlow<()> {
        if ending::is_due() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// See [`watch`]. Gone from the screen when it is dropped.
pub(super) struct Watching {
    bar: ProgressBar,
    stage: Mutex<Option<Stage>>,
}

impl Watch for Watching {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        if let Ok(mut stage) = self.stage.try_lock() {
            if *stage != Some(progress.stage) || progress.done == 0 {
                *stage = Some(progress.stage);
                self.bar.set_message(progress.stage.name());
                self.bar.set_length(progress.total);
                ending::doing(progress.stage.name(), &self.bar);
            }
            self.bar.set_position(progress.done);
        }
        if ending::is_due() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn bar_style() -> ProgressStyle {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent}% {eta}");
    style.unwrap_or_else(|_| ProgressStyle::default_bar())
}

fn new(quiet: bool, length: u64) -> ProgressBar {
    if quiet || !std::io::stderr().is_terminal() {
        // Counts all the same: whoever ends the run is told how far it was.
        return ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::hidden());
    }
    ProgressBar::new(length)
}
