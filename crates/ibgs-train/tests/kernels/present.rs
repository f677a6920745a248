//! What the screen shows against the pictures of the host.

use crate::small::small_model;
use ibgs_core::dataset::Photo;
use ibgs_core::gpu::Gpu;
use ibgs_core::picture::Picture;
use ibgs_core::present::{Presenter, Shown};
use ibgs_core::render::Frame;
use ibgs_core::sources::DevicePhoto;

/// The texture's pixels, RGB.
fn pixels(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<u8> {
    let (width, height) = (texture.width(), texture.height());
    let row = (4 * width).next_multiple_of(256);
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
    let target = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), target, texture.size());
    gpu.queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    gpu.wait().unwrap();
    let bytes = buffer.get_mapped_range(..).unwrap();
    let rows = bytes.chunks_exact(row as usize).map(|row| &row[..4 * width as usize]);
    rows.flat_map(|row| row.chunks_exact(4)).flat_map(|p| [p[0], p[1], p[2]]).collect()
}

fn texture(gpu: &Gpu, frame: &Frame) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: frame.camera().width, height: frame.camera().height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

#[test]
fn every_part_of_a_frame_looks_as_on_the_host() {
    let (renderer, dataset) = small_model();
    let gpu = renderer.gpu().clone();
    let view = &dataset.views[dataset.test[0]];
    let frame = renderer.render(&view.camera).unwrap();
    let (w, h) = (view.camera.width, view.camera.height);
    let (base, image) = (frame.base().unwrap().rgb, frame.image().unwrap().unwrap().rgb);
    let residual: Vec<f32> = image.iter().zip(&base).map(|(a, b)| a - b).collect();
    let photo: Vec<u8> = view.photo.pixels().unwrap().rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    let stronger: Vec<f32> = residual.iter().map(|v| 4.0 * v).collect();
    let difference: Vec<f32> = image.iter().zip(&photo).map(|(a, &b)| a - f32::from(b) / 255.0).collect();
    let depth = frame.depth().unwrap().unwrap();
    let range = [2.0, 6.0];
    // The scale below the picture stays behind.
    let depth_picture = Picture::depth(w, h, &depth, Some(range)).rgb[..photo.len()].to_vec();
    let visibility = frame.visibility().unwrap().unwrap();
    let target = DevicePhoto::upload(&gpu, &view.photo.pixels().unwrap()).unwrap();
    let mut masked = Photo::clone(&view.photo.pixels().unwrap());
    masked.rgba.chunks_exact_mut(8).for_each(|pair| (pair[3], pair[7]) = (127, 128));
    let grey = |p: &[u8]| ((f32::from(p[0]) + f32::from(p[1]) + f32::from(p[2])) / 6.0).round() as u8;
    let hidden = |pair: &[u8]| [pair[0], pair[1], pair[2], grey(&pair[4..]), grey(&pair[4..]), grey(&pair[4..])];
    let hidden: Vec<u8> = masked.rgba.chunks_exact(8).flat_map(hidden).collect();
    let masked = DevicePhoto::upload(&gpu, &masked).unwrap();
    // With how much two roundings may differ: colours of the palette are between its 256.
    let cases = [
        ("final", Shown::Final, Picture::colors(w, h, &image).rgb, 1),
        ("base", Shown::Base, Picture::colors(w, h, &base).rgb, 1),
        ("residual", Shown::Residual(1.0), Picture::residual(w, h, &residual).rgb, 1),
        ("stronger residual", Shown::Residual(4.0), Picture::residual(w, h, &stronger).rgb, 1),
        ("depth", Shown::Depth(range), depth_picture, 3),
        ("normal", Shown::Normal, Picture::normals(w, h, &frame.normals().unwrap().unwrap()).rgb, 1),
        ("visibility", Shown::Visibility(3), Picture::visibility(w, h, &visibility, 3).rgb, 1),
        ("difference", Shown::Difference(&target, 1.0), Picture::residual(w, h, &difference).rgb, 1),
        ("photo", Shown::Photo(&target), photo, 0),
        ("hidden", Shown::Hidden(&masked), hidden, 1),
    ];
    let mut presenter = Presenter::new(gpu.clone()).unwrap();
    let texture = texture(&gpu, &frame);
    for (name, shown, expected, tolerance) in cases {
        presenter.present(&frame, &shown, &texture).unwrap();
        let ours = pixels(&gpu, &texture);
        assert!(expected.iter().any(|&v| v != expected[0]), "{name}: nothing to see");
        let worst = ours.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(ours.len() == expected.len() && worst <= tolerance, "{name}: {worst} apart");
        assert!(presenter.picture(&frame, &shown).unwrap() == ours, "{name}: the host gets another picture");
    }
    // One depth alone, at a place.
    for (x, y) in [(0, 0), (w / 2, h / 2), (w - 1, h - 1)] {
        let z = depth[(y * w + x) as usize];
        assert_eq!(frame.depth_at(x, y).unwrap(), Some(z).filter(|&z| z > 0.0));
    }
    assert_eq!(frame.depth_at(w, 0).unwrap(), None);
}
