//! Short forms for bind-group layouts, and a bind group that is made anew only when its parts change.

/// Entries of bind-group layouts.
pub mod entries {
    use wgpu::{
        BindGroupLayoutEntry, BindingType, BufferBindingType, ShaderStages, TextureFormat,
        TextureSampleType, TextureViewDimension,
    };

    fn entry(binding: u32, visibility: ShaderStages, ty: BindingType) -> BindGroupLayoutEntry {
        BindGroupLayoutEntry { binding, visibility, ty, count: None }
    }

    /// A uniform buffer.
    #[must_use]
    pub fn uniform(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        buffer(binding, stages, BufferBindingType::Uniform)
    }

    /// A uniform buffer with a dynamic offset.
    #[must_use]
    pub fn dynamic_uniform(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        let ty = BindingType::Buffer {
            ty: BufferBindingType::Uniform,
            has_dynamic_offset: true,
            min_binding_size: None,
        };
        entry(binding, stages, ty)
    }

    /// A read-only storage buffer.
    #[must_use]
    pub fn storage(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        buffer(binding, stages, BufferBindingType::Storage { read_only: true })
    }

    /// A storage buffer that may be written.
    #[must_use]
    pub fn write_storage(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        buffer(binding, stages, BufferBindingType::Storage { read_only: false })
    }

    fn buffer(binding: u32, stages: ShaderStages, ty: BufferBindingType) -> BindGroupLayoutEntry {
        let ty = BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        entry(binding, stages, ty)
    }

    /// A texture that is read texel by texel (`texture_2d<f32>`, or an array of them).
    #[must_use]
    pub fn texels(binding: u32, stages: ShaderStages, array: bool) -> BindGroupLayoutEntry {
        texture(binding, stages, array, TextureSampleType::Float { filterable: false })
    }

    /// A depth texture for a comparison sampler (`texture_depth_2d_array`).
    #[must_use]
    pub fn depth_array(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        texture(binding, stages, true, TextureSampleType::Depth)
    }

    /// A texture of unsigned integers (`texture_2d_array<u32>`).
    #[must_use]
    pub fn unsigned_array(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        texture(binding, stages, true, TextureSampleType::Uint)
    }

    fn texture(
        binding: u32,
        stages: ShaderStages,
        array: bool,
        sample_type: TextureSampleType,
    ) -> BindGroupLayoutEntry {
        let view_dimension =
            if array { TextureViewDimension::D2Array } else { TextureViewDimension::D2 };
        entry(
            binding,
            stages,
            BindingType::Texture { sample_type, view_dimension, multisampled: false },
        )
    }

    /// A texture of integers, as of a stencil (`texture_2d<u32>`).
    #[must_use]
    pub fn integers(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        texture(binding, stages, false, TextureSampleType::Uint)
    }

    /// A comparison sampler.
    #[must_use]
    pub fn comparison_sampler(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        entry(binding, stages, BindingType::Sampler(wgpu::SamplerBindingType::Comparison))
    }

    /// A sampler for gathering texels as they are.
    #[must_use]
    pub fn nearest_sampler(binding: u32, stages: ShaderStages) -> BindGroupLayoutEntry {
        entry(binding, stages, BindingType::Sampler(wgpu::SamplerBindingType::NonFiltering))
    }

    /// A storage texture that is only written.
    #[must_use]
    pub fn write_texture(
        binding: u32,
        stages: ShaderStages,
        format: TextureFormat,
    ) -> BindGroupLayoutEntry {
        write(binding, stages, format, TextureViewDimension::D2)
    }

    /// As [`write_texture`], for an array texture.
    #[must_use]
    pub fn write_array(
        binding: u32,
        stages: ShaderStages,
        format: TextureFormat,
    ) -> BindGroupLayoutEntry {
        write(binding, stages, format, TextureViewDimension::D2Array)
    }

    fn write(
        binding: u32,
        stages: ShaderStages,
        format: TextureFormat,
        view_dimension: TextureViewDimension,
    ) -> BindGroupLayoutEntry {
        let access = wgpu::StorageTextureAccess::WriteOnly;
        entry(binding, stages, BindingType::StorageTexture { access, format, view_dimension })
    }

    /// A storage texture that is read and written; of format `R32Float`, `R32Uint` or `R32Sint`.
    #[must_use]
    pub fn read_write_texture(
        binding: u32,
        stages: ShaderStages,
        format: TextureFormat,
    ) -> BindGroupLayoutEntry {
        let access = wgpu::StorageTextureAccess::ReadWrite;
        let view_dimension = TextureViewDimension::D2;
        entry(binding, stages, BindingType::StorageTexture { access, format, view_dimension })
    }
}

/// A bind group that is kept as long as the resources in it stay the same, so that a steady frame
/// makes none.
#[derive(Debug)]
pub struct BindGroupCache<Key> {
    kept: Option<(Key, wgpu::BindGroup)>,
}

impl<Key> Default for BindGroupCache<Key> {
    fn default() -> Self {
        Self { kept: None }
    }
}

impl<Key: PartialEq> BindGroupCache<Key> {
    /// The bind group for `key`, made by `make` when the key is a new one.
    pub fn get(
        &mut self,
        key: Key,
        make: impl FnOnce(&Key) -> wgpu::BindGroup,
    ) -> &wgpu::BindGroup {
        if self.kept.as_ref().is_none_or(|(kept, _)| *kept != key) {
            self.kept = None;
        }
        &self
            .kept
            .get_or_insert_with(|| {
                let group = make(&key);
                (key, group)
            })
            .1
    }

    /// The bind group made last, if any.
    #[must_use]
    pub fn kept(&self) -> Option<&wgpu::BindGroup> {
        self.kept.as_ref().map(|(_, group)| group)
    }
}

/// Entries of bind groups.
pub mod bind {
    use wgpu::{BindGroupEntry, BindingResource};

    /// A whole buffer.
    #[must_use]
    pub fn buffer(binding: u32, buffer: &wgpu::Buffer) -> BindGroupEntry<'_> {
        BindGroupEntry { binding, resource: buffer.as_entire_binding() }
    }

    /// A texture.
    #[must_use]
    pub fn texture(binding: u32, view: &wgpu::TextureView) -> BindGroupEntry<'_> {
        BindGroupEntry { binding, resource: BindingResource::TextureView(view) }
    }

    /// A sampler.
    #[must_use]
    pub fn sampler(binding: u32, sampler: &wgpu::Sampler) -> BindGroupEntry<'_> {
        BindGroupEntry { binding, resource: BindingResource::Sampler(sampler) }
    }
}
