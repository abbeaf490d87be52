//! What the workspace's tests share.

use antumbra_gpu::{Gpu, GpuOptions, Recorder, wgpu};
use glam::DVec3;

/// The device that tests run on.
///
/// # Panics
/// When there is no adapter; `cargo xtask test` installs a software one where it may.
#[must_use]
pub fn gpu() -> Gpu {
    match Gpu::new(&GpuOptions::default()) {
        Ok(gpu) => gpu,
        Err(error) => panic!("{error}"),
    }
}

/// One in `of` of `all`, each time others as `turn` goes on: what takes all lights in turn sees every one of `all`, each
/// under some of the lights. For tests in which layout and estimator, which meet at link time, need not meet all in all.
pub fn one_in<T>(of: usize, turn: usize, all: Vec<T>) -> impl Iterator<Item = T> {
    all.into_iter().skip(turn % of).step_by(of)
}

/// Seeded random numbers, the same everywhere: SplitMix64 (Steele, Lea, Flood 2014).
#[derive(Clone, Copy, Debug)]
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Evenly spread in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 0.5f64.powi(53)
    }

    /// Evenly spread in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Three of [`Random::signed`].
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.signed(), self.signed(), self.signed())
    }

    /// A whole number below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }
}

/// A square float image of `size` texels a side and as many channels as there are values, 1, 2 or 4, as a `D2Array` view.
///
/// # Panics
/// When the device has no room for it.
#[must_use]
pub fn image(gpu: &Gpu, size: u32, values: &[f32]) -> wgpu::TextureView {
    let channels = values.len() as u32 / (size * size);
    let descriptor = wgpu::TextureDescriptor {
        label: Some("an image"),
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: match channels {
            1 => wgpu::TextureFormat::R32Float,
            2 => wgpu::TextureFormat::Rg32Float,
            _ => wgpu::TextureFormat::Rgba32Float,
        },
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let texture = match gpu.create_texture("an image", &descriptor) {
        Ok(texture) => texture,
        Err(error) => panic!("{error}"),
    };
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
    gpu.queue.write_texture(
        texture.as_image_copy(),
        &bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * channels * size),
            rows_per_image: None,
        },
        texture.size(),
    );
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// Submits what `record` records.
pub fn submit(gpu: &Gpu, record: impl FnOnce(&mut Recorder<'_>)) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    record(&mut Recorder::new(&mut encoder));
    gpu.queue.submit([encoder.finish()]);
}

/// An array of square textures, to draw into and to read from.
#[must_use]
pub fn texture(gpu: &Gpu, format: wgpu::TextureFormat, side: u32, layers: u32) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("the caller's"),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}
