//! Progress, told to a function of JavaScript, which may end the work.

use std::ops::ControlFlow;

use js_sys::Function;
use splitplane::Progress;
use wasm_bindgen::JsValue;

#[cfg(any(feature = "page", not(feature = "gpu")))]
pub(crate) use at_once::watched;
#[cfg(feature = "gpu")]
pub(crate) use waiting::Called;

fn call(called: &Function, progress: &Progress) -> ControlFlow<()> {
    let (stage, done, total) = (progress.stage.name(), progress.done as f64, progress.total as f64);
    let ends = called.call3(&JsValue::NULL, &stage.into(), &done.into(), &total.into());
    match ends {
        Ok(ends) if !ends.is_truthy() => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    }
}

/// Functions of work that is done in one piece.
#[cfg(any(feature = "page", not(feature = "gpu")))]
mod at_once {
    use std::cell::RefCell;
    use std::ops::ControlFlow;

    use js_sys::Function;
    use splitplane::{Progress, Watch};

    use super::call;

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
            call(&called, progress)
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
}

/// Functions of work that others come in between of.
#[cfg(feature = "gpu")]
mod waiting {
    use std::cell::RefCell;
    use std::collections::BTreeMap;
    use std::ops::ControlFlow;

    use js_sys::Function;
    use splitplane::{Progress, Watch};

    use super::call;

    thread_local! {
        static WAITING: RefCell<(u32, BTreeMap<u32, Function>)> = const { RefCell::new((0, BTreeMap::new())) };
    }

    /// Calls a function of JavaScript, for as long as it lives.
    pub(crate) struct Called(u32);

    impl Called {
        pub(crate) fn new(function: Function) -> Called {
            WAITING.with_borrow_mut(|(next, functions)| {
                *next += 1;
                functions.insert(*next, function);
                Called(*next)
            })
        }

        /// Itself, as work takes it.
        pub(crate) fn watch(&self) -> &dyn Watch {
            self
        }
    }

    impl Drop for Called {
        fn drop(&mut self) {
            WAITING.with_borrow_mut(|(_, functions)| functions.remove(&self.0));
        }
    }

    impl Watch for Called {
        fn progress(&self, progress: &Progress) -> ControlFlow<()> {
            let function = WAITING.with_borrow(|(_, functions)| functions.get(&self.0).cloned());
            function.map_or(ControlFlow::Continue(()), |function| call(&function, progress))
        }
    }
}
