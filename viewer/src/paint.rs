//! Draws a frame of the window: the picture, and over it what egui has to show.

use super::blit::{Blit, Picture, Place};
use super::source::FrameDevice;
use image::RgbaImage;

/// Behind everything.
const GROUND: wgpu::Color = wgpu::Color { r: 0.086, g: 0.09, b: 0.1, a: 1.0 };

/// What is to be drawn.
pub(super) struct Content<'a> {
    pub(super) picture: Option<(&'a Picture, Place)>,
    pub(super) interface: &'a [egui::ClippedPrimitive],
    pub(super) size: [u32; 2],
    pub(super) points: f32,
}

/// The pipelines for targets of one format.
pub(super) struct Painter {
    blit: Blit,
    egui: egui_wgpu::Renderer,
    format: wgpu::TextureFormat,
}

impl Painter {
    pub(super) fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Painter {
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        let egui = egui_wgpu::Renderer::new(device, format, options);
        Painter { blit: Blit::new(device, format), egui, format }
    }

    /// Takes up new textures of the interface; before the interface that uses them is drawn.
    pub(super) fn take_textures(&mut self, gpu: &FrameDevice, delta: &mut egui::TexturesDelta) {
        for (id, images) in delta.set.drain() {
            for image in images {
                self.egui.update_texture(&gpu.device, &gpu.queue, id, &image);
            }
        }
    }

    /// Lets textures go that the interface no longer uses; after it was drawn.
    pub(super) fn free_textures(&mut self, delta: &mut egui::TexturesDelta) {
        for id in delta.free.drain() {
            self.egui.free_texture(&id);
        }
    }

    /// Draws on a texture of the format.
    pub(super) fn draw(
        &mut self,
        gpu: &FrameDevice,
        target: &wgpu::Texture,
        content: &Content<'_>,
    ) {
        let device = &gpu.device;
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        let label = Some("window");
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label });
        let screen = egui_wgpu::ScreenDescriptor {
            size_in_pixels: content.size,
            pixels_per_point: content.points,
        };
        let mut commands =
            self.egui.update_buffers(device, &gpu.queue, &mut encoder, content.interface, &screen);
        let place = content
            .picture
            .map(|(picture, place)| (self.blit.prepare(device, &gpu.queue, picture, place), place));
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label,
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(GROUND),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        // egui's renderer asks for a pass without a lifetime; it ends before the encoder does.
        let mut pass = pass.forget_lifetime();
        if let Some((bindings, place)) = &place {
            self.blit.draw(&mut pass, bindings, *place);
        }
        self.egui.render(&mut pass, content.interface, &screen);
        drop(pass);
        commands.push(encoder.finish());
        gpu.queue.submit(commands);
    }

    /// Draws the same off the screen and reads it back.
    pub(super) fn screenshot(
        &mut self,
        gpu: &FrameDevice,
        content: &Content<'_>,
    ) -> Result<RgbaImage, String> {
        use wgpu::TextureFormat as Format;
        let swapped = match self.format {
            Format::Rgba8Unorm | Format::Rgba8UnormSrgb => false,
            Format::Bgra8Unorm | Format::Bgra8UnormSrgb => true,
            other => return Err(format!("pixels of the format {other:?} cannot be saved")),
        };
        let [width, height] = content.size;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("screenshot"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        self.draw(gpu, &texture, content);
        let stride = (width * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("screenshot"),
            size: u64::from(stride) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let rows = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(stride),
            rows_per_image: None,
        };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout: rows },
            size,
        );
        gpu.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| error.to_string())?;
        let bytes = buffer.get_mapped_range(..).map_err(|error| error.to_string())?;
        let mut image = RgbaImage::new(width, height);
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            let at = y as usize * stride as usize + x as usize * 4;
            let [mut r, g, mut b] = [bytes[at], bytes[at + 1], bytes[at + 2]];
            if swapped {
                std::mem::swap(&mut r, &mut b);
            }
            pixel.0 = [r, g, b, 255];
        }
        Ok(image)
    }
}
