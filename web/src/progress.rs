//! Progress, told to a function of JavaScript, which may end the work.

use std::cell::RefCell;
use std::ops::ControlFlow;

use js_sys::Function;
use splitplane::{Progress, Watch};
use wasm_bindgen::JsValue;

thread_local! {
    /// The function of the work that is under way. Values of JavaScript are not for other threads, so a watch cannot hold one.
    static CALLED: RefCell<Option<Function>> = const { RefCell::new(None) };
}

/// Tells the function of [`watched`]. It is called as (stage, done, total), and ends the work where it gives `true`.
struct Told;

impl Watch for Told {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let Some(called) = CALLED.with_borrow(Clone::clone) else {
            return ControlFlow::Continue(());
        };
        let (stage, done, total) =
            (progress.stage.name(), progress.done as f64, progress.total as f64);
        let ends = called.call3(&JsValue::NULL, &stage.into(), &done.into(), &total.into());
        match ends {
            Ok(ends) if !ends.is_truthy() => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    }
}

/// Does the work with a watch where a function is given.
pub(crate) fn watched<T>(
    called: Option<Function>,
    work: impl FnOnce(Option<&dyn Watch>) -> T,
) -> T {
    if called.is_none() {
        return work(None);
    }
    // The function may itself begin such work.
    let outer = CALLED.replace(called);
    let done = work(Some(&Told));
    CALLED.set(outer);
    done
}
