//! Opening a GPU: the one that was asked for, or one good enough for `auto`.

use super::connect::connect;
use super::{Engine, OpenError, OpenOptions, OpenedEngine, in_environment};
use splitplane_wgpu::adapters::{Adapter, AdapterReport};
use splitplane_wgpu::probe::Tried;
use splitplane_wgpu::{Adapters, DriverLimit, Gpu, GpuError, Parity};
use std::thread;

/// A backend over a device, and what its self-test found.
type Connected = (Engine, Parity);

/// The GPU adapters of this machine, each opened and tested. None is no error.
pub fn adapters() -> Vec<AdapterReport> {
    adapters_with(&OpenOptions::default())
}

/// As [`adapters`]; with [`OpenOptions::probe`] each is tested in a process of its own, so that no driver can take
/// this one down, and one that exceeds a limit is ended. These processes run at the same time, so that the list takes as
/// long as the slowest driver. Of the other options the driver's limits matter.
pub fn adapters_with(options: &OpenOptions) -> Vec<AdapterReport> {
    let adapters = Adapters::find();
    // What is opened in this process is opened by itself: the growth of its memory is the driver's.
    if options.probe.is_none() {
        return adapters.list().iter().map(|adapter| report(adapter, options)).collect();
    }
    at_once(adapters.list(), |adapter| report(adapter, options))
}

/// What `work` makes of each item, in their order, all at the same time.
fn at_once<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    thread::scope(|scope| {
        let work = &work;
        let started: Vec<_> = items
            .iter()
            .map(|item| (item, thread::Builder::new().spawn_scoped(scope, move || work(item))))
            .collect();
        let ended = started.into_iter().map(|(item, thread)| match thread.map(|it| it.join()) {
            Ok(Ok(made)) => made,
            Ok(Err(panic)) => std::panic::resume_unwind(panic),
            // No thread could be started.
            Err(_) => work(item),
        });
        ended.collect()
    })
}

fn report(adapter: &Adapter, options: &OpenOptions) -> AdapterReport {
    if let Some(reason) = adapter.unusable() {
        return adapter.report_as(Err(reason.to_owned()));
    }
    let tried = options
        .probe
        .as_ref()
        .map_or(Tried::NotStarted, |probe| probe.run(adapter, &device_options(options)));
    adapter.report_as(match tried {
        Tried::Parity(parity) => Ok(parity),
        Tried::Failed(reason) | Tried::Died(reason) => Err(reason),
        Tried::Exceeded { doing, limit } => Err(passed_over(&doing, limit)),
        _ => test_here(adapter, options),
    })
}

/// Opens and tests an adapter in this process.
fn test_here(adapter: &Adapter, options: &OpenOptions) -> Result<Parity, String> {
    use splitplane_wgpu::OpenError::{DriverLimit, Unusable};
    let gpu = adapter.open(&device_options(options)).map_err(|error| match error {
        Unusable { reason, .. } => reason,
        DriverLimit { doing, limit, .. } => passed_over(&doing, limit),
        error => error.to_string(),
    })?;
    connect(gpu).map(|(_, parity)| parity).map_err(|error| match error {
        GpuError::DriverLimit { doing, limit } => passed_over(&doing, limit),
        error => format!("its self-test did not run: {error}"),
    })
}

fn passed_over(doing: &str, limit: DriverLimit) -> String {
    format!("its driver did not finish {doing} within {limit}")
}

/// Opens the device that [`super::BackendKind::Wgpu`] would, without a backend over it: for callers
/// that want [`splitplane_wgpu`]'s own types.
///
/// # Errors
/// There is no such device, or it cannot be used.
pub fn open_gpu(options: &OpenOptions) -> Result<Gpu, OpenError> {
    let adapters = Adapters::find();
    let adapter = adapters.select(options.adapter.as_deref())?;
    try_unknown(adapter, options)?;
    Ok(adapter.open(&device_options(options))?)
}

/// Opens the GPU that was asked for, or the best one.
pub(super) fn open(options: &OpenOptions) -> Result<OpenedEngine, OpenError> {
    let adapters = Adapters::find();
    let adapter = adapters.select(options.adapter.as_deref())?;
    let connected = open_adapter(adapter, options)?;
    allowed(adapter.name(), connected, options.allow_structural)
}

/// Refuses a device that is not bitwise equal, unless that is allowed.
fn allowed(
    adapter: &str,
    (engine, parity): Connected,
    allow_structural: bool,
) -> Result<OpenedEngine, OpenError> {
    match parity {
        Parity::Bitwise => Ok(OpenedEngine { engine, reason: "asked for; parity: bitwise".into() }),
        Parity::Structural(difference) if allow_structural => {
            let reason = format!("asked for; parity: structural, allowed: {difference}");
            Ok(OpenedEngine { engine, reason })
        }
        Parity::Structural(difference) => {
            Err(OpenError::Structural { adapter: adapter.to_owned(), difference })
        }
    }
}

/// What `auto` knows of an adapter before it opens it.
struct Candidate<'a> {
    name: &'a str,
    software: bool,
    unusable: Option<&'a str>,
}

/// Opens the best adapter that is hardware and bitwise equal, or says why there is none. A name in the
/// environment that no adapter has is passed over: it may be meant for another program.
///
/// # Errors
/// An adapter that was named in `options` and is not there.
pub(super) fn open_hardware(
    options: &OpenOptions,
) -> Result<Result<OpenedEngine, String>, OpenError> {
    let adapters = Adapters::find();
    let mut passed_over = Vec::new();
    let ranked = match (adapters.ranked(options.adapter.as_deref()), &options.adapter) {
        (Ok(ranked), _) => ranked,
        (Err(splitplane_wgpu::OpenError::NoAdapter), None) => Vec::new(),
        (Err(splitplane_wgpu::OpenError::WrongAdapter { asked, .. }), None) => {
            passed_over.push(format!("no GPU adapter is called `{asked}` (WGPU_ADAPTER_NAME)"));
            adapters.all_ranked()
        }
        (Err(error), _) => return Err(error.into()),
    };
    let candidates: Vec<Candidate<'_>> = ranked
        .iter()
        .map(|adapter| Candidate {
            name: adapter.name(),
            software: adapter.is_software(),
            unusable: adapter.unusable(),
        })
        .collect();
    Ok(first_bitwise(&candidates, passed_over, |index| open_adapter(ranked[index], options)))
}

/// Opens the first candidate that will do; otherwise says, of each, why it will not. `passed_over`
/// holds what there is to say before that.
fn first_bitwise(
    candidates: &[Candidate<'_>],
    mut passed_over: Vec<String>,
    open: impl Fn(usize) -> Result<Connected, OpenError>,
) -> Result<OpenedEngine, String> {
    for (index, candidate) in candidates.iter().enumerate() {
        let name = candidate.name;
        if candidate.software {
            passed_over.push(format!("`{name}` is software"));
        } else if let Some(reason) = candidate.unusable {
            passed_over.push(format!("`{name}` cannot be used: {reason}"));
        } else {
            match open(index) {
                Ok((engine, Parity::Bitwise)) => {
                    let mut reason = format!("auto: `{name}` is hardware; parity: bitwise");
                    if !passed_over.is_empty() {
                        reason.push_str(&format!("; {}", passed_over.join("; ")));
                    }
                    return Ok(OpenedEngine { engine, reason });
                }
                Ok((_, Parity::Structural(difference))) => passed_over
                    .push(format!("`{name}` differs from the CPU in some bits ({difference})")),
                Err(error) => passed_over.push(error.to_string()),
            }
        }
    }
    match passed_over.is_empty() {
        true => Err(format!("no GPU adapter was found{}", in_environment())),
        false => Err(passed_over.join("; ")),
    }
}

fn open_adapter(adapter: &Adapter, options: &OpenOptions) -> Result<Connected, OpenError> {
    try_unknown(adapter, options)?;
    let gpu = adapter.open(&device_options(options))?;
    connect(gpu).map_err(|error| failed(adapter.name(), &adapter.info().driver, &error))
}

/// Tries an adapter whose driver nobody knows in a process of its own, if there is a command for that.
///
/// # Errors
/// Its driver took more than it may, or ended the process.
fn try_unknown(adapter: &Adapter, options: &OpenOptions) -> Result<(), OpenError> {
    let Some(probe) = &options.probe else { return Ok(()) };
    match probe.run_unknown(adapter, &device_options(options)) {
        Some(Tried::Exceeded { doing, limit }) => Err(adapter.exceeds(doing, limit).into()),
        Some(Tried::Died(reason)) => {
            Err(OpenError::DeviceFailed { adapter: adapter.name().to_owned(), reason })
        }
        // What else is wrong with it is found again when it is opened here, in its own words; and where
        // nothing could be started, the limits hold in this process too.
        _ => Ok(()),
    }
}

/// What is asked of a device once its adapter is chosen.
fn device_options(options: &OpenOptions) -> splitplane_wgpu::OpenOptions {
    splitplane_wgpu::OpenOptions {
        adapter: None,
        default_limits: options.default_limits,
        timeout: options.timeout,
        driver_time: options.driver_time,
        driver_memory: options.driver_memory,
        ray_stack: None,
    }
}

/// Why an adapter that opened is no backend.
pub fn failed(adapter: &str, driver: &str, error: &GpuError) -> OpenError {
    let (adapter, reason) = (adapter.to_owned(), error.to_string());
    match error {
        GpuError::DriverLimit { doing, limit } => {
            let (driver, doing) = (driver.to_owned(), doing.clone());
            OpenError::DriverLimit { adapter, driver, doing, limit: *limit }
        }
        GpuError::Lost { .. } | GpuError::TimedOut { .. } => {
            OpenError::DeviceFailed { adapter, reason }
        }
        _ => OpenError::Unusable { adapter, reason },
    }
}

impl From<splitplane_wgpu::OpenError> for OpenError {
    fn from(error: splitplane_wgpu::OpenError) -> OpenError {
        match error {
            splitplane_wgpu::OpenError::NoAdapter => OpenError::NoAdapter,
            splitplane_wgpu::OpenError::WrongAdapter { asked, seen } => {
                OpenError::WrongAdapter { asked, seen }
            }
            splitplane_wgpu::OpenError::Unusable { adapter, reason } => {
                OpenError::Unusable { adapter, reason }
            }
            splitplane_wgpu::OpenError::DriverLimit { adapter, driver, doing, limit } => {
                OpenError::DriverLimit { adapter, driver, doing, limit }
            }
            other => OpenError::Unusable { adapter: "GPU".into(), reason: other.to_string() },
        }
    }
}

#[cfg(all(test, feature = "cpu"))]
mod tests {
    use super::*;

    fn candidate(name: &str) -> Candidate<'_> {
        Candidate { name, software: false, unusable: None }
    }

    fn endless() -> GpuError {
        let limit = DriverLimit::Time(std::time::Duration::from_secs(20));
        GpuError::DriverLimit { doing: "compiling `closest_hit`".into(), limit }
    }

    /// Any backend will do: what is tested is which one is taken.
    fn connected(parity: Parity) -> Result<Connected, OpenError> {
        Ok((Engine::Cpu(splitplane_cpu::CpuBackend::new()), parity))
    }

    /// Each waits for the other, so that one after the other would wait for ever.
    #[test]
    fn drivers_are_tried_at_the_same_time_and_reported_in_order() {
        let both = std::sync::Barrier::new(2);
        let made = at_once(&[3, 4], |&number| {
            both.wait();
            10 * number
        });
        assert_eq!(made, [30, 40]);
    }

    #[test]
    fn auto_takes_the_first_bitwise_hardware_and_says_what_it_passed_over() {
        let candidates = [
            Candidate { unusable: Some("it has no compute shaders"), ..candidate("old") },
            candidate("odd"),
            candidate("broken"),
            candidate("endless"),
            candidate("good"),
            candidate("good too"),
        ];
        let opened = first_bitwise(&candidates, Vec::new(), |index| match index {
            1 => connected(Parity::Structural("quotients".into())),
            2 => Err(failed("broken", "beta", &GpuError::Lost { reason: "gone".into() })),
            3 => Err(failed("endless", "beta", &endless())),
            4 => connected(Parity::Bitwise),
            other => panic!("{other} is opened without need"),
        });
        assert_eq!(
            opened.unwrap().reason,
            "auto: `good` is hardware; parity: bitwise; `old` cannot be used: it has no compute \
             shaders; `odd` differs from the CPU in some bits (quotients); the GPU adapter \
             `broken` failed when it was opened: the device was lost: gone; the driver of the GPU \
             adapter `endless` (beta) did not finish compiling `closest_hit` within 20 seconds"
        );
    }

    #[test]
    fn auto_never_opens_software() {
        let software = [Candidate { software: true, ..candidate("llvmpipe") }];
        let why = first_bitwise(&software, Vec::new(), |_| panic!("it is opened")).unwrap_err();
        assert_eq!(why, "`llvmpipe` is software");
        let why = first_bitwise(&[], Vec::new(), |_| panic!("there is none")).unwrap_err();
        assert!(why.starts_with("no GPU adapter was found"), "{why}");
    }

    #[test]
    fn auto_says_that_it_passed_over_a_name_in_the_environment() {
        let passed_over = || vec!["no GPU adapter is called `radeon` (WGPU_ADAPTER_NAME)".into()];
        let opened =
            first_bitwise(&[candidate("good")], passed_over(), |_| connected(Parity::Bitwise));
        assert_eq!(
            opened.unwrap().reason,
            "auto: `good` is hardware; parity: bitwise; no GPU adapter is called `radeon` \
             (WGPU_ADAPTER_NAME)"
        );
    }

    #[test]
    fn a_structural_adapter_must_be_allowed() {
        let structural = || connected(Parity::Structural("quotients".into())).unwrap();
        let error = allowed("odd", structural(), false).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the GPU adapter `odd` differs from the CPU in some bits (quotients), which was not allowed"
        );
        let opened = allowed("odd", structural(), true).unwrap();
        assert!(opened.reason.contains("structural, allowed: quotients"), "{}", opened.reason);
        let bitwise = connected(Parity::Bitwise).unwrap();
        assert_eq!(allowed("good", bitwise, false).unwrap().reason, "asked for; parity: bitwise");
    }

    #[test]
    fn a_device_that_fails_is_told_from_one_that_cannot_be_used() {
        let timed_out = failed("slow", "beta", &GpuError::TimedOut { seconds: 60 });
        assert!(matches!(timed_out, OpenError::DeviceFailed { .. }));
        let refused = failed("odd", "beta", &GpuError::Refused("no".into()));
        assert!(matches!(refused, OpenError::Unusable { .. }));
    }
}
