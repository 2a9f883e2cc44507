//! Lists adapters, tells which of them can be used, chooses one, and opens it.

use std::time::Duration;

use crate::device::bounded::{self, Unfinished};
use crate::device::driver;
use crate::device::gpu::Gpu;
use crate::device::needs;
use crate::device::wait::Wait;
use crate::error::{DriverLimit, GpuError, OpenError};
use crate::options::OpenOptions;
use crate::parity::Parity;

/// The adapters that wgpu sees, in the order it reports them.
#[derive(Clone, Debug)]
pub struct Adapters {
    list: Vec<Adapter>,
}

/// One adapter.
#[derive(Clone, Debug)]
pub struct Adapter {
    index: usize,
    adapter: wgpu::Adapter,
    info: wgpu::AdapterInfo,
    unusable: Option<String>,
}

/// The report on an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct AdapterReport {
    /// Its place in the list; [`OpenOptions::adapter`] takes it.
    pub index: usize,
    /// Its name.
    pub name: String,
    /// The interface it is reached through: `vulkan`, `metal`, `dx12`.
    pub backend: &'static str,
    /// `discrete`, `integrated`, `virtual`, `software` or `other`.
    pub device_type: &'static str,
    /// The driver's name.
    pub driver: String,
    /// The driver's version and whatever else it says.
    pub driver_info: String,
    /// The limits that matter here.
    pub limits: AdapterLimits,
    /// Whether kernels can be timed on the device.
    pub timestamps: bool,
    /// What the self-test found; `None` when the adapter cannot be used.
    pub parity: Option<Parity>,
    /// Why the adapter cannot be used.
    pub unusable: Option<String>,
}

/// The limits that decide what fits a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct AdapterLimits {
    /// Most bytes of one storage buffer.
    pub max_storage_buffer_binding_size: u64,
    /// Most bytes of any buffer.
    pub max_buffer_size: u64,
    /// Most storage buffers of one kernel.
    pub max_storage_buffers_per_shader_stage: u32,
    /// Most invocations of one workgroup.
    pub max_compute_invocations_per_workgroup: u32,
    /// Most bytes that a workgroup shares.
    pub max_compute_workgroup_storage_size: u32,
}

/// All adapters, each opened and tested by `test`.
pub fn adapters(test: impl Fn(&Gpu) -> Result<Parity, GpuError>) -> Vec<AdapterReport> {
    Adapters::find().list().iter().map(|adapter| adapter.report(&test)).collect()
}

impl Adapters {
    /// The adapters of all backends of this build, or of those that the environment variable
    /// `WGPU_BACKEND` names. Opens no window and no device.
    ///
    /// A page in a browser cannot block: there this finds none, and [`Adapters::find_async`] does.
    pub fn find() -> Adapters {
        instance().map_or(Adapters { list: Vec::new() }, |instance| Adapters::find_in(&instance))
    }

    /// As [`Adapters::find`], without blocking. A browser gives one adapter, or none.
    pub async fn find_async() -> Adapters {
        match instance() {
            Some(instance) => Adapters::find_in_async(&instance).await,
            None => Adapters { list: Vec::new() },
        }
    }

    /// The adapters of an instance that a host has.
    pub fn find_in(instance: &wgpu::Instance) -> Adapters {
        if Wait::Blocking.check().is_err() {
            return Adapters { list: Vec::new() };
        }
        pollster::block_on(Adapters::find_in_async(instance))
    }

    /// As [`Adapters::find_in`], without blocking.
    pub async fn find_in_async(instance: &wgpu::Instance) -> Adapters {
        let found = instance.enumerate_adapters(wgpu::Backends::all()).await;
        let mut list = Vec::new();
        for (index, adapter) in found.into_iter().enumerate() {
            list.push(Adapter::new(index, adapter));
        }
        #[cfg(target_family = "wasm")]
        if let [only] = &mut list[..]
            && let Some(name) = super::web::adapter_name().await
        {
            only.info.name = name;
        }
        Adapters { list }
    }

    /// All adapters, in the order of their indices.
    pub fn list(&self) -> &[Adapter] {
        &self.list
    }

    /// The adapter to take: the best of those that `asked` or else the environment variable
    /// `WGPU_ADAPTER_NAME` names, hardware before software. `WGPU_POWER_PREF=low` puts integrated
    /// before discrete ones.
    ///
    /// # Errors
    /// No adapter, none of this name, or only unusable ones.
    pub fn select(&self, asked: Option<&str>) -> Result<&Adapter, OpenError> {
        let ranked = self.ranked(asked)?;
        let best = ranked.first().copied().ok_or(OpenError::NoAdapter)?;
        match &best.unusable {
            None => Ok(best),
            Some(reason) => Err(best.refuse(reason)),
        }
    }

    /// The adapters that may be taken, best first; never an empty list. Unusable adapters come
    /// last.
    ///
    /// # Errors
    /// No adapter, or none of this name.
    pub fn ranked(&self, asked: Option<&str>) -> Result<Vec<&Adapter>, OpenError> {
        if self.list.is_empty() {
            return Err(OpenError::NoAdapter);
        }
        let from_env = std::env::var("WGPU_ADAPTER_NAME").ok().filter(|name| !name.is_empty());
        let names: Vec<&str> = self.list.iter().map(Adapter::name).collect();
        let found = matching(&names, asked.or(from_env.as_deref()))?;
        Ok(best_first(found.into_iter().map(|index| &self.list[index]).collect()))
    }

    /// All adapters, best first, whatever `WGPU_ADAPTER_NAME` says. Unusable adapters come last.
    pub fn all_ranked(&self) -> Vec<&Adapter> {
        best_first(self.list.iter().collect())
    }
}

/// An instance of all backends of this build, or of those that the environment names; `None` where the build has none.
fn instance() -> Option<wgpu::Instance> {
    if wgpu::Instance::enabled_backend_features().is_empty() {
        return None;
    }
    let mut description = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    // No kernel is dispatched indirectly, and this check would keep buffers below 4 GiB.
    description.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
    Some(wgpu::Instance::new(description))
}

/// Puts usable adapters first, the best of them in front.
fn best_first(mut adapters: Vec<&Adapter>) -> Vec<&Adapter> {
    let low_power = wgpu::PowerPreference::from_env() == Some(wgpu::PowerPreference::LowPower);
    adapters.sort_by_key(|adapter| {
        (adapter.unusable.is_some(), rank(adapter.info.device_type, low_power), adapter.index)
    });
    adapters
}

/// The indices of the matching names. A number is an index where the list is that long, and
/// part of a name otherwise.
fn matching(names: &[&str], asked: Option<&str>) -> Result<Vec<usize>, OpenError> {
    let Some(asked) = asked else { return Ok((0..names.len()).collect()) };
    if let Some(index) = asked.parse().ok().filter(|index| *index < names.len()) {
        return Ok(vec![index]);
    }
    let wanted = asked.to_lowercase();
    let found: Vec<usize> = (0..names.len())
        .filter(|&index| !wanted.is_empty() && names[index].to_lowercase().contains(&wanted))
        .collect();
    if found.is_empty() {
        let seen = names.iter().map(|&name| name.to_owned()).collect();
        return Err(OpenError::WrongAdapter { asked: asked.to_owned(), seen });
    }
    Ok(found)
}

/// Least is best.
fn rank(device_type: wgpu::DeviceType, low_power: bool) -> u8 {
    match device_type {
        wgpu::DeviceType::DiscreteGpu if low_power => 2,
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 3,
        wgpu::DeviceType::Other => 4,
        wgpu::DeviceType::Cpu => 5,
    }
}

impl Gpu {
    /// Opens a device without a window, on the adapter that [`Adapters::select`] takes.
    ///
    /// # Errors
    /// No adapter, none of the name, none that can be used, or a driver that takes too much.
    pub fn open(options: &OpenOptions) -> Result<Gpu, OpenError> {
        Adapters::find().select(options.adapter.as_deref())?.open(options)
    }

    /// As [`Gpu::open`], without blocking a page. Elsewhere a thread of the driver's is waited for.
    ///
    /// # Errors
    /// As for [`Gpu::open`].
    pub async fn open_async(options: &OpenOptions) -> Result<Gpu, OpenError> {
        let adapters = Adapters::find_async().await;
        adapters.select(options.adapter.as_deref())?.open_async(options).await
    }

    /// Like [`Gpu::open`], with an instance of the host.
    ///
    /// # Errors
    /// As for [`Gpu::open`].
    pub fn open_in(instance: &wgpu::Instance, options: &OpenOptions) -> Result<Gpu, OpenError> {
        Adapters::find_in(instance).select(options.adapter.as_deref())?.open(options)
    }
}

impl Adapter {
    fn new(index: usize, adapter: wgpu::Adapter) -> Adapter {
        let unusable = needs::unmet(&adapter.limits(), &adapter.get_downlevel_capabilities());
        Adapter { index, info: adapter.get_info(), adapter, unusable }
    }

    /// Its place in the list.
    pub fn index(&self) -> usize {
        self.index
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// wgpu's information about it.
    pub fn info(&self) -> &wgpu::AdapterInfo {
        &self.info
    }

    /// True when this adapter runs on the CPU.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// True for hardware of vendors whose drivers compile shaders of this size every day, and for
    /// Mesa's llvmpipe. Try other adapters in a child process first: see
    /// [`OpenOptions::driver_time`].
    pub fn is_trusted(&self) -> bool {
        driver::is_trusted(&self.info)
    }

    /// What [`OpenOptions::driver_time`] is for this adapter when it is not given.
    pub fn default_driver_time(&self) -> Duration {
        driver::default_time(&self.info)
    }

    /// Why it cannot be used; `None` when it can.
    pub fn unusable(&self) -> Option<&str> {
        self.unusable.as_deref()
    }

    /// Opens a device on this adapter.
    ///
    /// # Errors
    /// An adapter that cannot be used, or that would not open; a driver that takes too much.
    pub fn open(&self, options: &OpenOptions) -> Result<Gpu, OpenError> {
        self.check()?;
        let (adapter, description) = (self.adapter.clone(), self.wanted(options));
        let opened = bounded::run(&driver::bounds(options, &self.info), None, move || {
            Wait::Blocking.check().map_err(|error| error.to_string())?;
            let opened = pollster::block_on(adapter.request_device(&description));
            opened.map_err(|error| error.to_string())
        });
        let (device, queue) = match opened {
            Ok(opened) => opened.map_err(|reason| self.refuse(&reason))?,
            Err(Unfinished::NotStarted(reason)) => {
                return Err(self.refuse(&format!("no thread can be started: {reason}")));
            }
            Err(Unfinished::Exceeded(limit)) => {
                return Err(self.exceeds("opening a device".into(), limit));
            }
        };
        Ok(Gpu::own(device, queue, options))
    }

    /// As [`Adapter::open`], without blocking a page. Elsewhere a thread of the driver's is waited for.
    ///
    /// # Errors
    /// As for [`Adapter::open`].
    #[cfg(not(target_family = "wasm"))]
    pub async fn open_async(&self, options: &OpenOptions) -> Result<Gpu, OpenError> {
        self.open(options)
    }

    /// As [`Adapter::open`], without blocking.
    ///
    /// # Errors
    /// As for [`Adapter::open`].
    #[cfg(target_family = "wasm")]
    pub async fn open_async(&self, options: &OpenOptions) -> Result<Gpu, OpenError> {
        self.check()?;
        let limit = driver::bounds(options, &self.info).time;
        let description = self.wanted(options);
        let opened = super::web::within(limit, self.adapter.request_device(&description)).await;
        let opened = opened
            .ok_or_else(|| self.exceeds("opening a device".into(), DriverLimit::Time(limit)))?;
        let (device, queue) = opened.map_err(|error| self.refuse(&error.to_string()))?;
        Ok(Gpu::own(device, queue, options).named(&self.info.name, options))
    }

    fn check(&self) -> Result<(), OpenError> {
        self.unusable.as_deref().map_or(Ok(()), |reason| Err(self.refuse(reason)))
    }

    /// The device that is asked for.
    fn wanted(&self, options: &OpenOptions) -> wgpu::DeviceDescriptor<'static> {
        let offered = self.adapter.limits();
        // Limits of textures and the like may be below the defaults; no kernel notices. Above them
        // only the sizes of buffers matter.
        let mut limits = wgpu::Limits::default().or_worse_values_from(&offered);
        if !options.default_limits {
            limits.max_buffer_size = offered.max_buffer_size;
            limits.max_storage_buffer_binding_size = offered.max_storage_buffer_binding_size;
        }
        wgpu::DeviceDescriptor {
            label: Some("splitplane"),
            required_features: self.adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: limits,
            ..Default::default()
        }
    }

    /// The report on this adapter: opens it and runs `test` on the device.
    pub fn report(&self, test: impl Fn(&Gpu) -> Result<Parity, GpuError>) -> AdapterReport {
        self.report_as(match self.open(&OpenOptions::default()) {
            Ok(gpu) => test(&gpu).map_err(|error| match error {
                GpuError::DriverLimit { .. } => error.to_string(),
                error => format!("its self-test did not run: {error}"),
            }),
            Err(OpenError::Unusable { reason, .. }) => Err(reason),
            Err(error) => Err(error.to_string()),
        })
    }

    /// The report on this adapter, given the outcome of its test or the reason why it cannot be
    /// used. Opens nothing.
    pub fn report_as(&self, tested: Result<Parity, String>) -> AdapterReport {
        let limits = self.adapter.limits();
        let (parity, unusable) = match tested {
            Ok(parity) => (Some(parity), None),
            Err(reason) => (None, Some(reason)),
        };
        AdapterReport {
            index: self.index,
            name: self.info.name.clone(),
            backend: self.info.backend.to_str(),
            device_type: device_type_name(self.info.device_type),
            driver: self.info.driver.clone(),
            driver_info: self.info.driver_info.clone(),
            limits: AdapterLimits {
                max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
                max_buffer_size: limits.max_buffer_size,
                max_storage_buffers_per_shader_stage: limits.max_storage_buffers_per_shader_stage,
                max_compute_invocations_per_workgroup: limits.max_compute_invocations_per_workgroup,
                max_compute_workgroup_storage_size: limits.max_compute_workgroup_storage_size,
            },
            timestamps: self.adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
            parity,
            unusable,
        }
    }

    /// Its driver exceeded a limit.
    pub fn exceeds(&self, doing: String, limit: DriverLimit) -> OpenError {
        let (adapter, driver) = (self.info.name.clone(), self.info.driver.clone());
        OpenError::DriverLimit { adapter, driver, doing, limit }
    }

    fn refuse(&self, reason: &str) -> OpenError {
        OpenError::Unusable { adapter: self.info.name.clone(), reason: reason.to_owned() }
    }
}

fn device_type_name(device_type: wgpu::DeviceType) -> &'static str {
    match device_type {
        wgpu::DeviceType::DiscreteGpu => "discrete",
        wgpu::DeviceType::IntegratedGpu => "integrated",
        wgpu::DeviceType::VirtualGpu => "virtual",
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::Other => "other",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapters_are_meant_by_part_of_a_name_or_by_index() {
        let names = ["NVIDIA GeForce RTX 4090", "llvmpipe (LLVM 15)", "NVIDIA H200"];
        assert_eq!(matching(&names, None), Ok(vec![0, 1, 2]));
        assert_eq!(matching(&names, Some("LLVMpipe")), Ok(vec![1]));
        assert_eq!(matching(&names, Some("nvidia")), Ok(vec![0, 2]));
        assert_eq!(matching(&names, Some("2")), Ok(vec![2]));
        // No index, so part of a name.
        assert_eq!(matching(&names, Some("4090")), Ok(vec![0]));
        for wrong in ["radeon", "3", "-1", ""] {
            let error = matching(&names, Some(wrong)).unwrap_err();
            let text = error.to_string();
            assert!(matches!(error, OpenError::WrongAdapter { .. }));
            assert!(text.contains(&format!("`{wrong}`")) && text.contains("2 `NVIDIA H200`"));
        }
    }

    #[test]
    fn hardware_comes_before_software_and_discrete_before_integrated() {
        use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu};
        let order = |low_power| {
            let mut all = [Cpu, Other, VirtualGpu, DiscreteGpu, IntegratedGpu];
            all.sort_by_key(|&device_type| rank(device_type, low_power));
            all
        };
        assert_eq!(order(false), [DiscreteGpu, IntegratedGpu, VirtualGpu, Other, Cpu]);
        assert_eq!(order(true), [IntegratedGpu, DiscreteGpu, VirtualGpu, Other, Cpu]);
    }
}
