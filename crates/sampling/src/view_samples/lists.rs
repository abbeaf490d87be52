//! The buffers of the lists, the casters' work and its results.

use antumbra_gpu::{Gpu, GpuError};

/// The twin of `Piece` in `sampling/view_samples_casters.wesl`: triangle, first sample, and number of samples + 2^16
/// times that of the buckets.
pub(super) type Piece = [u32; 3];

/// Words of the state.
pub(super) const STATE_WORDS: u64 = 4;

/// Pieces of work that there is room for, whatever the casters: 3 MiB.
const LEAST_PIECES: u32 = 1 << 18;

/// How much there is to be room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Extent {
    /// Pixels of the view.
    pub(super) pixels: u32,
    /// Buckets of all faces.
    pub(super) buckets: u32,
    /// Blocks of casters.
    pub(super) blocks: u32,
    /// Pieces of work.
    pub(super) pieces: u32,
}

impl Extent {
    /// Room for twice as many blocks as now, so that a moving camera seldom asks for more, and for four pieces a
    /// triangle: what a small one needs that covers two rows. What has no room is done at once.
    pub(super) fn new(gpu: &Gpu, pixels: u32, buckets: u32, blocks: u32, block: u32) -> Self {
        let blocks = blocks.next_power_of_two();
        let most = gpu.device.limits().max_storage_buffer_binding_size / size_of::<Piece>() as u64;
        let wanted = u64::from(LEAST_PIECES).max(4 * u64::from(block) * u64::from(blocks));
        Self { pixels, buckets, blocks, pieces: wanted.min(most) as u32 }
    }

    /// Whether lists of this extent serve what needs `other`.
    pub(super) fn serves(&self, other: &Self) -> bool {
        (self.pixels, self.buckets) == (other.pixels, other.buckets)
            && self.blocks >= other.blocks
            && self.pieces >= other.pieces
    }
}

/// The buffers.
#[derive(Debug)]
pub(super) struct Lists {
    pub(super) extent: Extent,
    pub(super) buckets: wgpu::Buffer,
    pub(super) places: wgpu::Buffer,
    pub(super) listed: wgpu::Buffer,
    pub(super) dark: wgpu::Buffer,
    pub(super) state: wgpu::Buffer,
    pub(super) blocks: wgpu::Buffer,
    pub(super) pieces: wgpu::Buffer,
    /// Workgroups of the dispatch over pieces.
    pub(super) groups: wgpu::Buffer,
}

impl Lists {
    pub(super) fn new(gpu: &Gpu, extent: Extent) -> Result<Self, GpuError> {
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let buffer = |label, size: u64, more: wgpu::BufferUsages| {
            if size > limit {
                let what = "bytes of lists of view samples";
                return Err(GpuError::Limit { what, asked: size, limit });
            }
            Ok(gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | more,
                mapped_at_creation: false,
            }))
        };
        let (none, read) = (wgpu::BufferUsages::empty(), wgpu::BufferUsages::COPY_SRC);
        let pixels = u64::from(extent.pixels);
        Ok(Self {
            // The last one becomes the sum of all.
            buckets: buffer("buckets", 4 * (u64::from(extent.buckets) + 1), read)?,
            places: buffer("places of pixels", 8 * pixels, none)?,
            listed: buffer("listed samples", 16 * pixels, none)?,
            dark: buffer("samples in shadow", 4 * pixels.div_ceil(32), none)?,
            state: buffer("state", 4 * STATE_WORDS, read)?,
            blocks: buffer("blocks of casters", 8 * u64::from(extent.blocks), none)?,
            pieces: buffer("pieces", size_of::<Piece>() as u64 * u64::from(extent.pieces), read)?,
            groups: buffer("pieces' workgroups", 12, wgpu::BufferUsages::INDIRECT)?,
            extent,
        })
    }

    pub(super) fn all(&self) -> [&wgpu::Buffer; 8] {
        [
            &self.buckets,
            &self.places,
            &self.listed,
            &self.dark,
            &self.state,
            &self.blocks,
            &self.pieces,
            &self.groups,
        ]
    }
}
