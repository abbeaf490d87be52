//! What a lookup binds beside its store, in group 2: the depth map itself, and a buffer to count in.

use antumbra_gpu::{BindGroupCache, Counters, Gpu, GpuError, bind, entries, read_buffer};

/// The depth map beside the store, and what is counted.
#[derive(Debug)]
pub(crate) struct Depth {
    layout: wgpu::BindGroupLayout,
    tally: Option<wgpu::Buffer>,
    group: BindGroupCache<wgpu::TextureView>,
    nothing: Option<wgpu::TextureView>,
}

impl Depth {
    pub(crate) fn new(gpu: &Gpu, tally: bool) -> Self {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let all = [entries::texels(0, CS, true), entries::write_storage(1, CS)];
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("depth beside a store"),
            entries: &all[..1 + usize::from(tally)],
        });
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let tally = tally.then(|| gpu.buffer("tally", &[0; 8], usage));
        Self { layout, tally, group: BindGroupCache::default(), nothing: None }
    }

    /// What was counted since the last `prepare`. Waits.
    pub(crate) fn counts(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let Some(tally) = &self.tally else { return Ok(Counters::new()) };
        let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, tally, 8)?);
        let names = ["esm_lookups", "esm_one_by_one"];
        Ok(names.into_iter().zip(counts.into_iter().map(u64::from)).collect())
    }

    pub(crate) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    pub(crate) fn group(&self) -> Option<&wgpu::BindGroup> {
        self.group.kept()
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.tally.as_ref().map_or(0, wgpu::Buffer::size)
    }

    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        map: Option<&wgpu::TextureView>,
    ) -> Result<(), GpuError> {
        let view = match (map, &self.nothing) {
            (Some(map), _) => map.clone(),
            (None, Some(nothing)) => nothing.clone(),
            // The pass needs some texture even when no view reads it.
            (None, None) => self.nothing.insert(one_texel(gpu)?).clone(),
        };
        if let Some(tally) = &self.tally {
            gpu.queue.write_buffer(tally, 0, &[0; 8]);
        }
        self.group.get(view, |view| {
            let mut all = vec![bind::texture(0, view)];
            all.extend(self.tally.as_ref().map(|tally| bind::buffer(1, tally)));
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("depth beside a store"),
                layout: &self.layout,
                entries: &all,
            })
        });
        Ok(())
    }
}

fn one_texel(gpu: &Gpu) -> Result<wgpu::TextureView, GpuError> {
    let texture = gpu.create_texture(
        "empty depth",
        &wgpu::TextureDescriptor {
            label: Some("empty depth"),
            size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        },
    )?;
    Ok(texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    }))
}
