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
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

    use js_sys::Function;
    use splitplane::{Progress, Watch};

    use super::call;

    /// The function of work that is under way.
    struct Called {
        work: u64,
        function: Function,
        /// The number of the last progress that it was told.
        told: u64,
        is_inside: bool,
    }

    thread_local! {
        /// Values of JavaScript are not for other threads, so a watch cannot hold one. Work that a function itself begins comes after its own.
        static CALLED: RefCell<Vec<Called>> = const { RefCell::new(Vec::new()) };
    }

    static WORK: AtomicU64 = AtomicU64::new(0);

    /// Tells the function of [`watched`]. It is called as (stage, done, total), and ends the work where it gives `true`.
    struct Told {
        work: u64,
        /// How often there was progress.
        count: AtomicU64,
        is_ended: AtomicBool,
        #[cfg(feature = "threads")]
        relay: relay::Relay,
    }

    impl Told {
        /// Calls the function where this is its thread; whether it is.
        fn tell(&self, progress: &Progress, number: u64) -> bool {
            let function = CALLED.with_borrow_mut(|all| {
                let called = all.iter_mut().find(|called| called.work == self.work)?;
                // Others may have told more by now; and the function may be what runs this, by work of its own.
                let is_due = !called.is_inside && called.told < number;
                if is_due {
                    (called.is_inside, called.told) = (true, number);
                }
                Some(is_due.then(|| called.function.clone()))
            });
            let Some(due) = function else { return false };
            let Some(function) = due else { return true };
            if call(&function, progress).is_break() {
                self.is_ended.store(true, Relaxed);
            }
            CALLED.with_borrow_mut(|all| {
                if let Some(called) = all.iter_mut().find(|called| called.work == self.work) {
                    called.is_inside = false;
                }
            });
            true
        }
    }

    /// What work takes.
    struct Watching(Arc<Told>);

    impl Watch for Watching {
        fn progress(&self, progress: &Progress) -> ControlFlow<()> {
            let Watching(told) = self;
            let number = told.count.fetch_add(1, Relaxed) + 1;
            if !told.is_ended.load(Relaxed) && !told.tell(progress, number) {
                #[cfg(feature = "threads")]
                relay::send(told, progress, number);
            }
            match told.is_ended.load(Relaxed) {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        }
    }

    /// Does the work with a watch where a function is given.
    pub(crate) fn watched<T>(
        called: Option<Function>,
        work: impl FnOnce(Option<&dyn Watch>) -> T,
    ) -> T {
        let Some(function) = called else { return work(None) };
        let number = WORK.fetch_add(1, Relaxed);
        let told = Arc::new(Told {
            work: number,
            count: AtomicU64::new(0),
            is_ended: AtomicBool::new(false),
            #[cfg(feature = "threads")]
            relay: relay::Relay::default(),
        });
        let entry = Called { work: number, function, told: 0, is_inside: false };
        CALLED.with_borrow_mut(|all| all.push(entry));
        let done = work(Some(&Watching(told)));
        CALLED.with_borrow_mut(|all| all.retain(|called| called.work != number));
        done
    }

    /// Progress that a worker has seen, for the thread of the function: it may have nothing to do but to wait for that worker.
    #[cfg(feature = "threads")]
    mod relay {
        use std::sync::Arc;
        use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

        use splitplane::Progress;

        use super::Told;

        /// Milliseconds between two messages.
        const BETWEEN: u64 = 20;

        /// When the last one was sent, in milliseconds.
        #[derive(Default)]
        pub(super) struct Relay(AtomicU64);

        /// Has the thread of the function call it, when that thread waits. This one does not wait for it.
        pub(super) fn send(told: &Arc<Told>, progress: &Progress, number: u64) {
            let now = js_sys::Date::now() as u64;
            let before = told.relay.0.load(Relaxed);
            // Clocks may be set back.
            if now.abs_diff(before) < BETWEEN {
                return;
            }
            told.relay.0.store(now, Relaxed);
            let (told, progress) = (Arc::clone(told), *progress);
            rayon::spawn_broadcast(move |_| {
                if !told.is_ended.load(Relaxed) {
                    told.tell(&progress, number);
                }
            });
        }
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
