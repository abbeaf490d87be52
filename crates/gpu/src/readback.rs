//! From the GPU back to the CPU, for measurements and tests. These calls wait.

use crate::{Gpu, GpuError};

/// The first `size` bytes of `buffer`, which needs `COPY_SRC`.
///
/// # Errors
/// A lost device, or any error that wgpu reported since the last check.
pub fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer, size: u64) -> Result<Vec<u8>, GpuError> {
    let staging = staging(gpu, size);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
    gpu.queue.submit([encoder.finish()]);
    map(gpu, &staging)
}

/// All texels of a float texture (`R32Float`, `Rgba32Float` or `Depth32Float`; one layer, one mip), row
/// by row, channels interleaved. The texture needs `COPY_SRC`.
///
/// # Errors
/// A format without a whole number of `f32` channels, a lost device, or any error that wgpu reported
/// since the last check.
pub fn read_f32_texture(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    layer: u32,
) -> Result<Vec<f32>, GpuError> {
    use wgpu::TextureFormat::{Depth32Float, R32Float, Rg32Float, Rgba32Float};
    let bytes = match texture.format() {
        R32Float | Depth32Float => 4,
        Rg32Float => 8,
        Rgba32Float => 16,
        other => return Err(unreadable(other, "use a 32-bit float format")),
    };
    read_level(gpu, texture, [layer, 0], bytes, f32::from_ne_bytes)
}

/// As [`read_f32_texture`], for any layer and mip level.
///
/// # Errors
/// As [`read_f32_texture`].
pub fn read_f32_level(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    layer: u32,
    mip: u32,
) -> Result<Vec<f32>, GpuError> {
    use wgpu::TextureFormat::{R32Float, Rg32Float, Rgba32Float};
    let bytes = match texture.format() {
        R32Float => 4,
        Rg32Float => 8,
        Rgba32Float => 16,
        other => return Err(unreadable(other, "use a 32-bit float format")),
    };
    read_level(gpu, texture, [layer, mip], bytes, f32::from_ne_bytes)
}

/// As [`read_f32_texture`], for textures of integers (`R32Uint`, `Rg32Uint` or `Rgba32Uint`).
///
/// # Errors
/// As [`read_f32_texture`].
pub fn read_u32_texture(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    layer: u32,
) -> Result<Vec<u32>, GpuError> {
    use wgpu::TextureFormat::{R32Uint, Rg32Uint, Rgba32Uint};
    let bytes = match texture.format() {
        R32Uint => 4,
        Rg32Uint => 8,
        Rgba32Uint => 16,
        other => return Err(unreadable(other, "use a format of 32-bit unsigned integers")),
    };
    read_level(gpu, texture, [layer, 0], bytes, u32::from_ne_bytes)
}

fn unreadable(format: wgpu::TextureFormat, fix: &'static str) -> GpuError {
    let (what, value) = ("format of a texture to read back", format!("{format:?}"));
    GpuError::Invalid { what, value, fix }
}

fn read_level<T>(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    [layer, mip]: [u32; 2],
    bytes_per_texel: u32,
    value: impl Fn([u8; 4]) -> T,
) -> Result<Vec<T>, GpuError> {
    let side = |side: u32| (side >> mip).max(1);
    let (width, height) = (side(texture.width()), side(texture.height()));
    let row = width * bytes_per_texel;
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let staging = staging(gpu, u64::from(padded) * u64::from(height));
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let aspect = if texture.format().is_depth_stencil_format() {
        wgpu::TextureAspect::DepthOnly
    } else {
        wgpu::TextureAspect::All
    };
    encoder.copy_texture_to_buffer(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: mip,
            origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
            aspect,
        },
        wgpu::TexelCopyBufferInfo {
            buffer: &staging,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(padded),
                rows_per_image: None,
            },
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    gpu.queue.submit([encoder.finish()]);
    let bytes = map(gpu, &staging)?;
    let values = bytes
        .chunks_exact(padded as usize)
        .flat_map(|line| line[..row as usize].chunks_exact(4))
        .map(|b| value([b[0], b[1], b[2], b[3]]))
        .collect();
    Ok(values)
}

fn staging(gpu: &Gpu, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("readback"),
        size,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    })
}

fn map(gpu: &Gpu, staging: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
    let (sender, receiver) = std::sync::mpsc::channel();
    staging.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver outlives the wait below; a failed send means that nobody asks any more.
        let _ = sender.send(result);
    });
    gpu.wait()?;
    match receiver.try_recv() {
        Ok(Ok(())) => {}
        Ok(Err(e)) => return Err(GpuError::Validation(e.to_string())),
        Err(e) => return Err(GpuError::DeviceLost { reason: e.to_string() }),
    }
    let bytes =
        staging.get_mapped_range(..).map_err(|e| GpuError::Validation(e.to_string()))?.to_vec();
    staging.unmap();
    Ok(bytes)
}
