//! The driver's compiler, within limits.

use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use crate::device::bounded::{self, Bounds, Unfinished};
use crate::device::stopwatch::Stopwatch;
use crate::error::GpuError;

/// The limits of a device's driver for pipelines, and the pipelines that exceeded them.
#[derive(Default)]
pub(crate) struct Compiler {
    bounds: Bounds,
    /// An opening that is under way.
    opening: Mutex<Option<UnderWay>>,
    given_up: Mutex<Vec<GivenUp>>,
    made: AtomicU64,
    /// Runs before the driver: with it, tests simulate a driver that takes too much.
    planted: Option<Planted>,
}

/// Is called with the name of what is about to be compiled.
type Planted = Arc<dyn Fn(&str) + Send + Sync>;

/// The state of an opening.
#[derive(Debug)]
struct UnderWay {
    since: Arc<Mutex<Stopwatch>>,
    /// The first limit that was exceeded.
    exceeded: Option<GpuError>,
}

/// A pipeline for which the driver exceeded a limit.
struct GivenUp {
    source: String,
    error: GpuError,
    /// Removed if the driver finishes it after all.
    under_way: Weak<()>,
}

/// While it lives, the limit of time holds for all pipelines together.
pub(crate) struct Opening<'a> {
    compiler: &'a Compiler,
}

impl Opening<'_> {
    /// The first limit that the driver exceeded meanwhile. What a build reports has no type for it.
    pub(crate) fn exceeded(&self) -> Option<GpuError> {
        lock(&self.compiler.opening).as_ref()?.exceeded.clone()
    }
}

impl Drop for Opening<'_> {
    fn drop(&mut self) {
        *lock(&self.compiler.opening) = None;
    }
}

impl Compiler {
    pub(crate) fn new(bounds: Bounds) -> Compiler {
        Compiler { bounds, ..Compiler::default() }
    }

    pub(crate) fn planted(self, planted: impl Fn(&str) + Send + Sync + 'static) -> Compiler {
        Compiler { planted: Some(Arc::new(planted)), ..self }
    }

    pub(crate) fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    pub(crate) fn made(&self) -> u64 {
        self.made.load(Ordering::Relaxed)
    }

    pub(crate) fn opening(&self) -> Opening<'_> {
        let since = Arc::new(Mutex::new(Stopwatch::own()));
        *lock(&self.opening) = Some(UnderWay { since, exceeded: None });
        Opening { compiler: self }
    }

    /// Calls `make` with label and source in a thread of the driver's own.
    pub(crate) fn compile(
        &self,
        label: &str,
        source: &str,
        make: impl FnOnce(&str, &str) -> Result<wgpu::ComputePipeline, GpuError> + Send + 'static,
    ) -> Result<wgpu::ComputePipeline, GpuError> {
        self.refuse_given_up(source)?;
        let token = Arc::new(());
        let under_way = Arc::downgrade(&token);
        let work = {
            let planted = self.planted.clone();
            let (label, source) = (label.to_owned(), source.to_owned());
            move || {
                let _token = token;
                if let Some(planted) = planted {
                    planted(&label);
                }
                make(&label, &source)
            }
        };
        let opening = lock(&self.opening).as_ref().map(|opening| Arc::clone(&opening.since));
        match bounded::run(&self.bounds, opening.as_deref(), work) {
            Ok(made) => {
                self.made.fetch_add(u64::from(made.is_ok()), Ordering::Relaxed);
                made
            }
            Err(Unfinished::NotStarted(reason)) => {
                Err(GpuError::Refused(format!("no thread can be started to compile: {reason}")))
            }
            Err(Unfinished::Exceeded(limit)) => {
                let doing = format!("compiling `{label}`");
                let error = GpuError::DriverLimit { doing, limit };
                if let Some(opening) = &mut *lock(&self.opening) {
                    opening.exceeded.get_or_insert_with(|| error.clone());
                }
                let (source, given) = (source.to_owned(), error.clone());
                lock(&self.given_up).push(GivenUp { source, error, under_way });
                Err(given)
            }
        }
    }

    /// Refuses what the driver is still compiling: another attempt would only start another thread.
    fn refuse_given_up(&self, source: &str) -> Result<(), GpuError> {
        let mut given_up = lock(&self.given_up);
        given_up.retain(|one| one.under_way.strong_count() > 0);
        let known = given_up.iter().find(|one| one.source == source);
        known.map_or(Ok(()), |one| Err(one.error.clone()))
    }
}

impl fmt::Debug for Compiler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Compiler").field("bounds", &self.bounds).field("made", &self.made).finish()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
