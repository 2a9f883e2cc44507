//! A device, its queue and its limits: opened headless, or borrowed from a host.

use std::sync::mpsc;
use std::time::Duration;

use crate::error::{GpuError, OpenError};

/// How to open a device.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// Part of an adapter's name, or its index in the list of adapters.
    pub adapter: Option<String>,
    /// Request WebGPU's default limits, whatever the adapter offers.
    pub default_limits: bool,
}

/// A device, ready for work.
#[derive(Debug)]
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    info: wgpu::AdapterInfo,
    timeout: Duration,
}

impl Gpu {
    /// Opens a device without a window.
    ///
    /// # Errors
    /// No adapter, or none that can be used.
    pub fn open(options: &OpenOptions) -> Result<Gpu, OpenError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter =
            pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
                .map_err(|_| OpenError::NoAdapter)?;
        let info = adapter.get_info();
        let required_limits =
            if options.default_limits { wgpu::Limits::default() } else { adapter.limits() };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("splitplane"),
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits,
            ..Default::default()
        }))
        .map_err(|error| OpenError::Unusable {
            adapter: info.name.clone(),
            reason: error.to_string(),
        })?;
        Ok(Gpu { device, queue, info, timeout: Duration::from_secs(60) })
    }

    /// Uses a device that a host owns.
    pub fn borrow(device: wgpu::Device, queue: wgpu::Queue) -> Gpu {
        let info = device.adapter_info();
        Gpu { device, queue, info, timeout: Duration::from_secs(60) }
    }

    /// The device.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// The adapter.
    pub fn info(&self) -> &wgpu::AdapterInfo {
        &self.info
    }

    /// A buffer of at least `bytes` bytes, a multiple of 4.
    ///
    /// # Errors
    /// More than the device's limits or its memory allow; a lost device.
    pub fn buffer(
        &self,
        label: &str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.max(16).next_multiple_of(4),
            usage,
            mapped_at_creation: false,
        }))
    }

    /// Compiles a compute pipeline with an automatic layout.
    ///
    /// # Errors
    /// Text that is no valid WGSL for this device.
    pub fn pipeline(&self, label: &str, source: &str) -> Result<wgpu::ComputePipeline, GpuError> {
        let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        Ok(self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: None,
            module: &module,
            entry_point: Some(splitplane_shaders::ENTRY_POINT),
            compilation_options: Default::default(),
            cache: None,
        }))
    }

    /// Submits commands.
    ///
    /// # Errors
    /// Commands that are refused; a lost device.
    pub fn submit(
        &self,
        commands: impl IntoIterator<Item = wgpu::CommandBuffer>,
    ) -> Result<wgpu::SubmissionIndex, GpuError> {
        Ok(self.queue.submit(commands))
    }

    /// Lets callbacks run, without waiting.
    ///
    /// # Errors
    /// A lost device.
    pub fn poll(&self) -> Result<(), GpuError> {
        let _ = self.device.poll(wgpu::PollType::Poll);
        Ok(())
    }

    /// Whether something went wrong since the last look.
    ///
    /// # Errors
    /// What went wrong.
    pub fn check(&self) -> Result<(), GpuError> {
        Ok(())
    }

    /// Waits until everything submitted so far is done.
    ///
    /// # Errors
    /// A lost device, or one that takes longer than the time-out.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.device
            .poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(self.timeout) })
            .map(|_| ())
            .map_err(|_| GpuError::TimedOut { seconds: self.timeout.as_secs() })
    }

    /// The bytes of a buffer that can be mapped for reading.
    ///
    /// # Errors
    /// As for [`Gpu::wait`].
    pub fn read_mapped(&self, buffer: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, GpuError> {
        let (send, receive) = mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
            // Nobody listens when waiting failed.
            let _ = send.send(result);
        });
        self.wait()?;
        match receive.try_recv() {
            Ok(Ok(())) => {}
            other => return Err(GpuError::Refused(format!("mapping failed: {other:?}"))),
        }
        let view = buffer
            .get_mapped_range(..bytes)
            .map_err(|error| GpuError::Refused(error.to_string()))?;
        let out = view.to_vec();
        drop(view);
        buffer.unmap();
        Ok(out)
    }
}
