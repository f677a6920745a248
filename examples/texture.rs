//! Renders a frame of a trained model into a texture of a wgpu program that has a device of its own, as a game or an editor has.
//!
//! ```sh
//! cargo run --release --example texture -- output/my-scene
//! ```

#![expect(clippy::print_stdout, reason = "an example")]

use ibgs_core::gpu::{Gpu, device_descriptor};
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::present::{Presenter, Shown};
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let model = std::env::args_os().nth(1).map(PathBuf::from).ok_or("give a model folder or bundle")?;

    // The program's own device. ibgs needs all that `device_descriptor` asks for.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&device_descriptor(&adapter)))?;

    let gpu = Gpu::from_wgpu(instance, adapter, device.clone(), queue)?;
    let mut model = Model::open(&model, &ModelOptions::default())?;
    let renderer = model.renderer(&gpu)?;
    let view = model.cameras.first().ok_or("the model has no views")?;
    let frame = renderer.render(&view.camera)?;

    // An RGBA8 texture of the frame's size, which the program can sample in its own passes.
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("frame"),
        size: wgpu::Extent3d { width: view.camera.width, height: view.camera.height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8UnormSrgb,
        usage: wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    Presenter::new(gpu.clone())?.present(&frame, &Shown::Final, &texture)?;
    gpu.wait()?;
    println!("{} is in a texture of {} x {} pixels", view.name, texture.width(), texture.height());
    Ok(())
}
