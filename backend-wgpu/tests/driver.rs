//! Drivers that compile without end: simulated ones, which stall until the test releases them.

use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use crate::common;
use splitplane_core::backend::BuildOptions;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_test_support::scenes;
use splitplane_wgpu::adapters::AdapterReport;
use splitplane_wgpu::{
    Adapters, DeviceQueryError, DriverLimit, Gpu, GpuError, OpenError, OpenOptions, Parity,
    WgpuBackend,
};

const SHADER: &str = "@compute @workgroup_size(1) fn main() {}";
/// Long enough for whatever does not stall, however slow the machine.
const PATIENCE: Duration = Duration::from_secs(600);
/// For what stalls.
const SHORT: Duration = Duration::from_millis(50);

/// A device that computes nothing.
fn noop(options: &OpenOptions) -> Result<Gpu, OpenError> {
    let noop = wgpu::NoopBackendOptions::enabled();
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::NOOP,
        backend_options: wgpu::BackendOptions { noop, ..Default::default() },
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    Adapters::find_in(&instance).list()[0].open(options)
}

/// What a planted driver was asked to compile, and what lets it go on.
struct Planted {
    labels: Arc<Mutex<Vec<String>>>,
    /// Dropped to end all stalls.
    release: Option<mpsc::Sender<()>>,
}

impl Planted {
    fn labels(&self) -> Vec<String> {
        self.labels.lock().unwrap().clone()
    }

    fn count(&self, label: &str) -> usize {
        self.labels().iter().filter(|asked| *asked == label).count()
    }
}

/// A device whose driver does `first` for every pipeline and then stalls in those of this label.
fn planted(
    gpu: Gpu,
    label: &'static str,
    first: impl Fn(&str) + Send + Sync + 'static,
) -> (Gpu, Planted) {
    let (release, stall) = mpsc::channel::<()>();
    let stall = Mutex::new(stall);
    let labels = Arc::new(Mutex::new(Vec::new()));
    let seen = Arc::clone(&labels);
    let gpu = gpu.with_planted_driver(move |asked| {
        seen.lock().unwrap().push(asked.to_owned());
        first(asked);
        if asked == label {
            let _ = stall.lock().unwrap().recv();
        }
    });
    (gpu, Planted { labels, release: Some(release) })
}

fn exceeded(doing: &str, limit: DriverLimit) -> GpuError {
    GpuError::DriverLimit { doing: doing.into(), limit }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_driver_that_compiles_without_end_is_left() {
    let gpu = noop(&OpenOptions::default()).unwrap().with_driver_limits(SHORT, u64::MAX);
    let (gpu, mut driver) = planted(gpu, "endless", |_| {});
    let expected = exceeded("compiling `endless`", DriverLimit::Time(SHORT));
    assert_eq!(gpu.pipeline("endless", SHADER).unwrap_err(), expected);
    assert_eq!(
        expected.to_string(),
        "the device's driver did not finish compiling `endless` within 0.05 seconds"
    );
    // As long as it is at it, it is not asked again, by a clone neither.
    assert_eq!(gpu.clone().pipeline("endless", SHADER).unwrap_err(), expected);
    assert_eq!(driver.count("endless"), 1);
    // The device serves what it can.
    let gpu = gpu.with_driver_limits(PATIENCE, u64::MAX);
    let other = format!("{SHADER} // other");
    gpu.pipeline("other", &other).unwrap();
    gpu.check().unwrap();
    drop(driver.release.take());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_pipeline_that_was_given_up_can_be_had_once_the_driver_is_done() {
    let gpu = noop(&OpenOptions::default()).unwrap().with_driver_limits(SHORT, u64::MAX);
    let (gpu, mut driver) = planted(gpu, "late", |_| {});
    gpu.pipeline("late", SHADER).unwrap_err();
    drop(driver.release.take());
    let start = Instant::now();
    while let Err(error) = gpu.pipeline("late", SHADER) {
        assert_eq!(error, exceeded("compiling `late`", DriverLimit::Time(SHORT)));
        assert!(start.elapsed() < PATIENCE, "it stays given up");
        thread::sleep(Duration::from_millis(1));
    }
    assert!(driver.count("late") >= 2);
    assert_eq!(gpu.pipelines_made(), 1);
}

/// Really takes the memory: Linux says how much the process has.
#[test]
#[cfg(target_os = "linux")]
fn a_driver_that_takes_memory_without_end_is_left() {
    let most = 16 << 20;
    let gpu = noop(&OpenOptions::default()).unwrap().with_driver_limits(PATIENCE, most);
    let taken = Mutex::new(Vec::new());
    let (gpu, mut driver) = planted(gpu, "greedy", move |_| {
        taken.lock().unwrap().push(vec![1u8; 256 << 20]);
    });
    let expected = exceeded("compiling `greedy`", DriverLimit::Memory(most));
    assert_eq!(gpu.pipeline("greedy", SHADER).unwrap_err(), expected);
    assert!(expected.to_string().ends_with("within 16777216 bytes of memory"), "{expected}");
    drop(driver.release.take());
}

#[test]
fn a_device_is_not_opened_without_time() {
    let options = OpenOptions { driver_time: Some(Duration::ZERO), ..OpenOptions::default() };
    let error = noop(&options).unwrap_err();
    assert!(matches!(error, OpenError::DriverLimit { .. }));
    assert_eq!(
        error.to_string(),
        "the driver of the GPU adapter `noop wgpu backend` (wgpu) did not finish opening a device within 0 \
         seconds"
    );
}

/// The limits of the options are those of the device.
#[test]
fn opening_ends_at_the_first_pipeline_that_stalls() {
    let options = OpenOptions { driver_time: Some(SHORT), ..OpenOptions::default() };
    let (gpu, mut driver) = planted(noop(&options).unwrap(), "arithmetic_check", |_| {});
    let expected = exceeded("compiling `arithmetic_check`", DriverLimit::Time(SHORT));
    assert_eq!(WgpuBackend::new(gpu).unwrap_err(), expected);
    assert_eq!(driver.labels(), ["arithmetic_check"]);
    drop(driver.release.take());
}

#[test]
fn a_report_says_what_the_driver_was_doing() {
    let noop = wgpu::NoopBackendOptions::enabled();
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::NOOP,
        backend_options: wgpu::BackendOptions { noop, ..Default::default() },
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapters = Adapters::find_in(&instance);
    let limit = DriverLimit::Memory(5);
    let AdapterReport { parity, unusable, .. } =
        adapters.list()[0].report(|_| Err(exceeded("compiling `x`", limit)));
    assert_eq!(parity, None);
    let expected = "the device's driver did not finish compiling `x` within 5 bytes of memory";
    assert_eq!(unusable.as_deref(), Some(expected));
    assert_eq!(adapters.list()[0].report_as(Ok(Parity::Bitwise)).parity, Some(Parity::Bitwise));
}

/// The error of a build that is part of the self-test has a type too.
#[test]
fn a_kernel_of_the_builder_that_stalls_is_named() {
    // On a device that computes nothing the kernels before it take no time to speak of.
    let time = Duration::from_secs(2);
    let gpu = noop(&OpenOptions::default()).unwrap().with_driver_limits(time, u64::MAX);
    let (gpu, mut driver) = planted(gpu, "triangle_bounds", |_| {});
    let error = WgpuBackend::new(gpu).unwrap_err();
    assert_eq!(error, exceeded("compiling `triangle_bounds`", DriverLimit::Time(time)));
    assert_eq!(driver.labels().last().map(String::as_str), Some("triangle_bounds"));
    drop(driver.release.take());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn opening_makes_what_the_self_test_needs_and_nothing_is_made_twice() {
    let gpu = Gpu::clone(&common::gpu()).with_driver_limits(PATIENCE, u64::MAX);
    let (gpu, driver) = planted(gpu, "none", |_| {});
    let backend = WgpuBackend::new(gpu).unwrap();
    let made = driver.labels();
    assert_eq!(backend.gpu().pipelines_made(), made.len() as u64);
    for needed in [
        "arithmetic_check",
        "triangle_bounds",
        "triangle_limits",
        "closest_hit",
        "closest_hit_retry",
        "any_hit",
        "any_hit_retry",
    ] {
        assert_eq!(driver.count(needed), 1, "{needed} in {made:?}");
    }
    // No query but the two, each of two kernels, and of the builder no more than there is.
    let queries = splitplane_shaders::QUERIES.iter().map(|shader| shader.name);
    let builder = splitplane_shaders::KERNELS.iter().chain(splitplane_shaders::KERNEL_RETRIES);
    let builder = builder.map(|shader| shader.name);
    assert_eq!(made.iter().filter(|name| queries.clone().any(|q| q == *name)).count(), 5);
    let of_builder = made.iter().filter(|name| builder.clone().any(|k| k == *name)).count();
    assert_eq!(of_builder + 5 + 1, made.len(), "{made:?}");
    // A build and rays like those of the self-test make none.
    let scene = scenes::soup(700, 0.1, 3);
    let options = QueryOptions::default();
    let rays = [Ray::new([0.5; 3], [1.0, 0.0, 0.0])];
    let mut hits = [Hit::MISS];
    for _ in 0..2 {
        let tree = backend.build_on_device(&scene.mesh(), &BuildOptions::default()).unwrap().tree;
        backend.queries().closest_hits(&tree, &rays, &mut hits, &options).unwrap();
        backend.queries().any_hits(&tree, &rays, &mut [false], &options).unwrap();
        assert_eq!(driver.labels(), made);
    }
    // Another query makes its two, once.
    let tree = backend.build_on_device(&scene.mesh(), &BuildOptions::default()).unwrap().tree;
    let fast = QueryOptions { accuracy: Accuracy::Fast, ..options };
    for _ in 0..2 {
        backend.queries().closest_hits(&tree, &rays, &mut hits, &fast).unwrap();
        assert_eq!(driver.labels()[made.len()..], ["closest_hit_fast", "closest_hit_retry_fast"]);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_driver_that_cannot_compile_the_exact_query_serves_the_others() {
    let gpu = Gpu::clone(&common::gpu()).with_driver_limits(PATIENCE, u64::MAX);
    let opened = WgpuBackend::new(gpu.clone()).unwrap();
    let (gpu, mut driver) =
        planted(gpu.with_driver_limits(SHORT, u64::MAX), "closest_hit_exact", |_| {});
    let queries = splitplane_wgpu::Queries::new(Arc::new(gpu));
    queries.set_parity(&Parity::Bitwise);
    let scene = scenes::soup(700, 0.1, 3);
    let tree = opened.build_on_device(&scene.mesh(), &BuildOptions::default()).unwrap().tree;
    let rays = [Ray::new([0.5; 3], [1.0, 0.0, 0.0])];
    let mut hits = [Hit::MISS];
    let exact = QueryOptions { accuracy: Accuracy::Exact, ..QueryOptions::default() };
    let error = queries.closest_hits(&tree, &rays, &mut hits, &exact).unwrap_err();
    let limit = DriverLimit::Time(SHORT);
    assert_eq!(error, DeviceQueryError::Gpu(exceeded("compiling `closest_hit_exact`", limit)));
    opened.queries().closest_hits(&tree, &rays, &mut hits, &QueryOptions::default()).unwrap();
    drop(driver.release.take());
}
