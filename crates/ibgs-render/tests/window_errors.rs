//! What goes wrong in a window that shares the device.

use ibgs_reference::gpu::device_of;
use ibgs_render::gpu::device_descriptor;

/// A window that was made larger paints beyond its surface until that is set up again: that frame is lost, and no more.
#[test]
fn a_lost_frame_of_a_window_is_no_fault_of_the_device() {
    let gpu = device_of(device_descriptor);
    gpu.watch();
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: 4, height: 4, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    // As egui paints.
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("encoder") });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store };
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("egui_render"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            resolve_target: None,
            ops,
            depth_slice: None,
        })],
        ..Default::default()
    });
    pass.set_scissor_rect(0, 0, 4, 8);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    gpu.check().unwrap();
    // What else is wrong stays a fault.
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE;
    let _ =
        gpu.device.create_buffer(&wgpu::BufferDescriptor { label: None, size: 4, usage, mapped_at_creation: false });
    gpu.check().unwrap_err();
}
