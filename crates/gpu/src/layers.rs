//! Square textures in an array, seen as a whole and one by one.

use crate::{Gpu, GpuError};

/// An array of square textures.
#[derive(Debug)]
pub struct Layers {
    /// The array itself.
    pub texture: wgpu::Texture,
    /// All of it, `D2Array`.
    pub whole: wgpu::TextureView,
    /// Each layer, `D2`.
    pub each: Vec<wgpu::TextureView>,
}

impl Layers {
    /// `count` layers of `size` texels a side; beyond `usage` they can be bound as a texture.
    ///
    /// # Errors
    /// A size or a number beyond the device's limits or of zero, or a failed allocation.
    pub fn new(
        gpu: &Gpu,
        label: &'static str,
        format: wgpu::TextureFormat,
        (size, count): (u32, u32),
        usage: wgpu::TextureUsages,
    ) -> Result<Self, GpuError> {
        let texture = gpu.create_texture(
            label,
            &wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: count },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
        )?;
        let view = |dimension, base_array_layer, count| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                label: Some(label),
                dimension: Some(dimension),
                base_array_layer,
                array_layer_count: Some(count),
                ..Default::default()
            })
        };
        let whole = view(wgpu::TextureViewDimension::D2Array, 0, count);
        let each = (0..count).map(|i| view(wgpu::TextureViewDimension::D2, i, 1)).collect();
        Ok(Self { texture, whole, each })
    }

    /// Whether there are `count` layers or more of `size` texels a side.
    #[must_use]
    pub fn has_room(&self, size: u32, count: usize) -> bool {
        self.texture.width() == size && self.each.len() >= count
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let texel = self.texture.format().block_copy_size(None).unwrap_or(4);
        u64::from(texel) * u64::from(self.texture.width()).pow(2) * self.each.len() as u64
    }
}
