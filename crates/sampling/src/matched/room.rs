//! The atlas, and the buffers of pages, slots and casters.

use antumbra_gpu::{Gpu, GpuError};

use super::Virtual;

/// The twin of `Slot` in `sampling/matched.wesl`, bytes.
const SLOT: u64 = 64;
/// Words of the state: counters, one of each level, of each rank, and of what is beyond.
const STATE_WORDS: u64 = 16 + 16 + 256 + 1;
/// Pairs of page and triangle that there is room for, whatever the casters: 4 MiB.
const LEAST_PAIRS: u32 = 1 << 20;

/// What lasts: what is known of the atlas.
#[derive(Debug)]
pub(super) struct Atlas {
    /// Of each page marks of this frame.
    pub(super) marks: wgpu::Buffer,
    /// Of each page 1 + its slot, or 0.
    pub(super) held: wgpu::Buffer,
    /// Of each page how many samples ask for it, and for it and those within it.
    pub(super) asked: wgpu::Buffer,
    pub(super) within: wgpu::Buffer,
    pub(super) slots: wgpu::Buffer,
    /// Pages that are asked for.
    pub(super) wanted: wgpu::Buffer,
    pub(super) state: wgpu::Buffer,
    /// Arguments of each slot's draw.
    pub(super) draws: wgpu::Buffer,
    /// The number of each slot, at `stride`.
    numbers: wgpu::Buffer,
    pub(super) number: wgpu::BindGroup,
    pub(super) stride: u32,
}

impl Atlas {
    pub(super) fn new(
        gpu: &Gpu,
        map: &Virtual,
        faces: u32,
        slot_layout: &wgpu::BindGroupLayout,
    ) -> Result<Self, GpuError> {
        let pages = u64::from(map.page_count()) * u64::from(faces);
        let slots = u64::from(map.slots());
        let stride = gpu.device.limits().min_uniform_buffer_offset_alignment.max(16);
        let mut numbers = vec![0u32; (slots * u64::from(stride) / 4) as usize];
        for (slot, words) in numbers.chunks_mut(stride as usize / 4).enumerate() {
            words[0] = slot as u32;
        }
        let numbers =
            gpu.buffer("slots", bytemuck::cast_slice(&numbers), wgpu::BufferUsages::UNIFORM);
        let number = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("slot"),
            layout: slot_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &numbers,
                    offset: 0,
                    size: wgpu::BufferSize::new(16),
                }),
            }],
        });
        let (none, indirect) = (wgpu::BufferUsages::empty(), wgpu::BufferUsages::INDIRECT);
        Ok(Self {
            marks: storage(gpu, "marks of pages", 4 * pages, none)?,
            held: storage(gpu, "slots of pages", 4 * pages, none)?,
            asked: storage(gpu, "samples of pages", 4 * pages, none)?,
            within: storage(gpu, "samples within pages", 4 * pages, none)?,
            slots: storage(gpu, "slots", SLOT * slots, none)?,
            wanted: storage(gpu, "pages asked for", 4 * pages, none)?,
            state: storage(gpu, "state", 4 * STATE_WORDS, none)?,
            draws: storage(gpu, "draws of pages", 16 * slots, indirect)?,
            numbers,
            number,
            stride,
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        let buffers = [
            &self.marks,
            &self.held,
            &self.asked,
            &self.within,
            &self.slots,
            &self.wanted,
            &self.state,
            &self.draws,
            &self.numbers,
        ];
        buffers.iter().map(|b| b.size()).sum::<u64>()
    }
}

/// What goes with the view's size and the number of casters.
#[derive(Debug)]
pub(super) struct Work {
    pixels: u32,
    /// Room for blocks of casters.
    room: u32,
    /// Room for pairs of page and triangle.
    pub(super) pairs_room: u32,
    pub(super) requests: wgpu::Buffer,
    pub(super) blocks: wgpu::Buffer,
    pub(super) pairs: wgpu::Buffer,
}

impl Work {
    /// Room for twice as many blocks as now, so that a moving camera seldom asks for more, and for eight pages a
    /// triangle.
    pub(super) fn new(gpu: &Gpu, pixels: u32, blocks: u32, block: u32) -> Result<Self, GpuError> {
        let room = blocks.max(1).next_power_of_two();
        let most = gpu.device.limits().max_storage_buffer_binding_size / 4;
        let wanted = u64::from(LEAST_PAIRS).max(8 * u64::from(block) * u64::from(room));
        let pairs_room = wanted.min(most) as u32;
        let none = wgpu::BufferUsages::empty();
        Ok(Self {
            pixels,
            room,
            pairs_room,
            requests: storage(gpu, "requests", 4 * u64::from(pixels), none)?,
            blocks: storage(gpu, "blocks of casters", 8 * u64::from(room), none)?,
            pairs: storage(gpu, "triangles of pages", 4 * u64::from(pairs_room), none)?,
        })
    }

    pub(super) fn serves(&self, pixels: u32, blocks: u32) -> bool {
        self.pixels == pixels && self.room >= blocks
    }

    pub(super) fn bytes(&self) -> u64 {
        self.requests.size() + self.blocks.size() + self.pairs.size()
    }
}

fn storage(
    gpu: &Gpu,
    label: &'static str,
    size: u64,
    more: wgpu::BufferUsages,
) -> Result<wgpu::Buffer, GpuError> {
    let limits = gpu.device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    if size > limit {
        return Err(GpuError::Limit { what: "bytes of a buffer of pages", asked: size, limit });
    }
    Ok(gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC
            | more,
        mapped_at_creation: false,
    }))
}
