//! Shows a buffer of pixels in a part of the window.

/// A picture on the device: one word a pixel, as [`super::FrameTarget::pixels`] says.
#[derive(Debug)]
pub(super) struct Picture {
    pub(super) pixels: wgpu::Buffer,
    pub(super) width: u32,
    pub(super) height: u32,
}

impl Picture {
    pub(super) fn new(device: &wgpu::Device, width: u32, height: u32) -> Picture {
        let pixels = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture"),
            size: u64::from(width) * u64::from(height) * 4,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Picture { pixels, width, height }
    }
}

/// A part of the window in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Place {
    pub(super) left: u32,
    pub(super) top: u32,
    pub(super) width: u32,
    pub(super) height: u32,
}

/// The pipeline that shows pictures on targets of one format.
#[derive(Debug)]
pub(super) struct Blit {
    pipeline: wgpu::RenderPipeline,
    uniforms: wgpu::Buffer,
    encodes: bool,
}

impl Blit {
    pub(super) fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Blit {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("blit"),
            source: wgpu::ShaderSource::Wgsl(include_str!("blit.wgsl").into()),
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("blit"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("colour"),
                compilation_options: Default::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let uniforms = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("blit"),
            size: 32,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Blit { pipeline, uniforms, encodes: format.is_srgb() }
    }

    /// Gets a picture ready to be shown at a place by the next [`Blit::draw`].
    pub(super) fn prepare(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        picture: &Picture,
        place: Place,
    ) -> wgpu::BindGroup {
        let [left, top, width, height] =
            [place.left, place.top, place.width, place.height].map(|side| side as f32);
        let floats = [left, top, width, height].map(f32::to_bits);
        let integers = [picture.width, picture.height, u32::from(self.encodes), 0];
        queue.write_buffer(&self.uniforms, 0, bytemuck::cast_slice(&[floats, integers]));
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("blit"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: picture.pixels.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: self.uniforms.as_entire_binding() },
            ],
        })
    }

    /// Draws a picture that is ready. The place must lie within the target.
    pub(super) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        bindings: &wgpu::BindGroup,
        place: Place,
    ) {
        let [left, top, width, height] =
            [place.left, place.top, place.width, place.height].map(|side| side as f32);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, bindings, &[]);
        pass.set_viewport(left, top, width, height, 0.0, 1.0);
        pass.draw(0..3, 0..1);
    }
}
