//! What the camera sees, as a tree of boxes, by which casters without a visible shadow are found.

use antumbra_gpu::{BindGroupCache, Gpu, GpuError, ViewSamples, bind, entries};
use glam::Vec4;

/// Room for `size` bytes, or for one element of any kind where that is nothing.
pub(crate) fn storage(gpu: &Gpu, label: &str, size: u64) -> Result<wgpu::Buffer, GpuError> {
    let size = size.max(32);
    let limits = gpu.device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    if size > limit {
        let what = "bytes of a list of shadow volumes' parts (split the casters)";
        return Err(GpuError::Limit { what, asked: size, limit });
    }
    Ok(gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_SRC
            | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    }))
}

/// Pixels a side of a block, and of a block of blocks; `volume/receivers.wesl` knows them too.
const BLOCK: u32 = 16;
const BLOCKS: u32 = 8 * BLOCK;
/// Bytes of a box.
const BOX: u64 = 32;

/// The passes that gather boxes, and the boxes.
#[derive(Debug)]
pub(crate) struct Receivers {
    gather: [wgpu::ComputePipeline; 2],
    layout: wgpu::BindGroupLayout,
    boxes: [wgpu::Buffer; 2],
    lit: wgpu::Buffer,
    size: Option<(u32, u32)>,
    group: BindGroupCache<([wgpu::TextureView; 2], wgpu::Buffer)>,
}

impl Receivers {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("receivers"),
            entries: &[
                entries::texels(0, CS, false),
                entries::write_storage(1, CS),
                entries::write_storage(2, CS),
                entries::uniform(3, CS),
                entries::texels(4, CS, false),
            ],
        });
        let module = gpu.shader("receivers", antumbra_shaders::link("volume::receivers", &[])?);
        let pipeline = |entry| gpu.compute_pipeline("receivers", &module, entry, &[&layout]);
        Ok(Self {
            gather: [pipeline("gather"), pipeline("gather_blocks")],
            boxes: [storage(gpu, "boxes", 0)?, storage(gpu, "boxes of boxes", 0)?],
            layout,
            lit: gpu.buffer("light of receivers", &[0; 32], wgpu::BufferUsages::UNIFORM),
            size: None,
            group: BindGroupCache::default(),
        })
    }

    /// Makes room for boxes around `samples`; with `None`, nothing will be gathered. Of no interest are samples that face away
    /// from the light, homogeneous, or that are beyond its reach, metres, 0 without end.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        samples: Option<&ViewSamples>,
        light: Vec4,
        reach: f32,
    ) -> Result<(), GpuError> {
        let Some(samples) = samples else {
            self.size = None;
            return Ok(());
        };
        let (width, height) = samples.size();
        let room =
            |block| BOX * u64::from(width.div_ceil(block)) * u64::from(height.div_ceil(block));
        for (boxes, block) in self.boxes.iter_mut().zip([BLOCK, BLOCKS]) {
            if boxes.size() < room(block) {
                *boxes = storage(gpu, "boxes", room(block))?;
            }
        }
        self.size = Some((width, height));
        gpu.queue.write_buffer(
            &self.lit,
            0,
            bytemuck::bytes_of(&[light, Vec4::X * reach].map(|v| v.to_array())),
        );
        let [fine, coarse] = &self.boxes;
        let views = [&samples.positions_view, &samples.normals_view].map(Clone::clone);
        self.group.get((views, fine.clone()), |([positions, normals], fine)| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("receivers"),
                layout: &self.layout,
                entries: &[
                    bind::texture(0, positions),
                    bind::buffer(1, fine),
                    bind::buffer(2, coarse),
                    bind::buffer(3, &self.lit),
                    bind::texture(4, normals),
                ],
            })
        });
        Ok(())
    }

    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        if let (Some((width, height)), Some(group)) = (self.size, self.group.kept()) {
            // A workgroup makes one box, or eight by eight boxes of boxes.
            for (gather, block) in self.gather.iter().zip([BLOCK, 8 * BLOCKS]) {
                pass.set_pipeline(gather);
                pass.set_bind_group(0, group, &[]);
                pass.dispatch_workgroups(width.div_ceil(block), height.div_ceil(block), 1);
            }
        }
    }

    /// Boxes around blocks of pixels, and around blocks of those.
    pub(crate) fn boxes(&self) -> [&wgpu::Buffer; 2] {
        self.boxes.each_ref()
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.boxes.iter().map(wgpu::Buffer::size).sum()
    }
}
