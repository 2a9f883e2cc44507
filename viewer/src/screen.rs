//! The window's surface and the device that draws on it.

use super::error::ViewerError;
use super::source::FrameDevice;
use splitplane::backend::OpenError;
use splitplane_wgpu::Adapters;
use splitplane_wgpu::adapters::Adapter;
use std::sync::Arc;
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

/// A surface, configured, and its device.
#[derive(Debug)]
pub(super) struct Screen {
    instance: wgpu::Instance,
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    /// A window without area has no surface to draw on.
    visible: bool,
    pub(super) gpu: FrameDevice,
}

/// What became of asking for a texture to draw on.
#[derive(Debug)]
pub(super) enum Acquired {
    /// Draw on this.
    Texture(wgpu::SurfaceTexture),
    /// Not now; ask again soon.
    Later,
    /// There is nothing to draw on until the window changes.
    Hidden,
}

impl Screen {
    /// Opens the adapter that was asked for, or the best that can draw in this window.
    pub(super) fn open(
        display: OwnedDisplayHandle,
        window: Arc<Window>,
        asked: Option<&str>,
    ) -> Result<Screen, ViewerError> {
        let display = Box::new(display);
        let mut description = wgpu::InstanceDescriptor::new_with_display_handle_from_env(display);
        // As for splitplane's own instances: nothing is dispatched indirectly, and the check would
        // keep buffers below 4 GiB.
        description.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
        let instance = wgpu::Instance::new(description);
        let adapters = Adapters::find_in(&instance);
        // Without any, there is no surface to be had either, and for a reason less clear.
        let ranked = adapters.ranked(asked).map_err(OpenError::from)?;
        let surface = instance
            .create_surface(Arc::clone(&window))
            .map_err(|error| ViewerError::Window(error.to_string()))?;
        let adapter = choose(&instance, &surface, &ranked)?;
        let gpu = open_device(&adapter)?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| ViewerError::NoSurface(vec![adapter.get_info().name]))?;
        let formats = surface.get_capabilities(&adapter).formats;
        // egui blends as displays encode; formats that encode by themselves come second.
        config.format = egui_wgpu::preferred_framebuffer_format(&formats)
            .map_err(|error| ViewerError::Window(error.to_string()))?;
        config.present_mode = wgpu::PresentMode::AutoVsync;
        config.desired_maximum_frame_latency = 2;
        let visible = size.width > 0 && size.height > 0;
        let screen = Screen { instance, window, surface, config, visible, gpu };
        if visible {
            screen.configure();
        }
        Ok(screen)
    }

    pub(super) fn format(&self) -> wgpu::TextureFormat {
        self.config.format
    }

    /// Width and height in pixels; `None` for a window without area.
    pub(super) fn size(&self) -> Option<[u32; 2]> {
        self.visible.then_some([self.config.width, self.config.height])
    }

    /// The window has another size; without area when it is minimised.
    pub(super) fn resize(&mut self, width: u32, height: u32) {
        let most = self.gpu.device.limits().max_texture_dimension_2d;
        self.visible = width > 0 && height > 0;
        if self.visible {
            (self.config.width, self.config.height) = (width.min(most), height.min(most));
            self.configure();
        }
    }

    /// A texture to draw on. A surface that is outdated or lost is made anew.
    pub(super) fn acquire(&mut self) -> Result<Acquired, ViewerError> {
        if !self.visible {
            return Ok(Acquired::Hidden);
        }
        use wgpu::CurrentSurfaceTexture as Current;
        match self.surface.get_current_texture() {
            Current::Success(texture) => Ok(Acquired::Texture(texture)),
            // What no longer fits the window is shown once; the event of the new size comes.
            Current::Suboptimal(texture) => Ok(Acquired::Texture(texture)),
            Current::Timeout => Ok(Acquired::Later),
            Current::Occluded => Ok(Acquired::Hidden),
            Current::Outdated | Current::Validation => {
                self.configure();
                Ok(Acquired::Later)
            }
            Current::Lost => {
                self.surface = self
                    .instance
                    .create_surface(Arc::clone(&self.window))
                    .map_err(|error| ViewerError::Window(error.to_string()))?;
                self.configure();
                Ok(Acquired::Later)
            }
        }
    }

    fn configure(&self) {
        self.surface.configure(&self.gpu.device, &self.config);
    }
}

/// The adapter to take: the first that can be used and can draw on the surface.
fn choose(
    instance: &wgpu::Instance,
    surface: &wgpu::Surface<'_>,
    ranked: &[&Adapter],
) -> Result<wgpu::Adapter, ViewerError> {
    // Both lists are in the order of the instance.
    let all = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let mut unusable = None;
    for candidate in ranked {
        if let Some(reason) = candidate.unusable() {
            let (adapter, reason) = (candidate.name().to_owned(), reason.to_owned());
            unusable.get_or_insert(OpenError::Unusable { adapter, reason });
            continue;
        }
        let adapter = all.get(candidate.index());
        if let Some(adapter) = adapter.filter(|adapter| adapter.is_surface_supported(surface)) {
            return Ok(adapter.clone());
        }
    }
    match unusable {
        Some(error) => Err(error.into()),
        None => {
            let names = ranked.iter().map(|adapter| adapter.name().to_owned());
            Err(ViewerError::NoSurface(names.collect()))
        }
    }
}

/// A device with WebGPU's default limits, and larger buffers where there are; with the limits of
/// textures that the adapter has, for large windows.
fn open_device(adapter: &wgpu::Adapter) -> Result<FrameDevice, ViewerError> {
    let offered = adapter.limits();
    let mut limits = wgpu::Limits::default().or_worse_values_from(&offered);
    limits.max_buffer_size = offered.max_buffer_size;
    limits.max_storage_buffer_binding_size = offered.max_storage_buffer_binding_size;
    limits.max_texture_dimension_2d = offered.max_texture_dimension_2d;
    let opened = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        label: Some("splitplane view"),
        required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
        required_limits: limits,
        ..Default::default()
    }));
    let (device, queue) = opened.map_err(|error| {
        let (adapter, reason) = (adapter.get_info().name, error.to_string());
        OpenError::Unusable { adapter, reason }
    })?;
    Ok(FrameDevice { device, queue })
}
