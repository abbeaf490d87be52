//! The faces of shadow volumes on the GPU: what a producer writes and the counting passes draw.
//!
//! A volume is bounded by *sides*, each over an edge and extended away from the light to infinity, by *near caps*,
//! triangles of the caster, and by *far caps*, the same triangles at infinity. All refer to the casters' own
//! vertices, so that faces of one edge are made of the same numbers whoever wrote them.

use antumbra_gpu::{CasterTriangles, Gpu, GpuError};

/// A side over the edge from vertex `a` to vertex `b`. The twin of `Side` in `volume/geometry.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Side {
    /// First vertex.
    pub a: u32,
    /// Second vertex.
    pub b: u32,
    /// How many volumes have the side, counted positive where (b - a) x (a - light) points out of them: 0 for
    /// none. A lone triangle has +1 over each edge that it passes from `b` to `a` where the light sees its
    /// corners run counter-clockwise, and -1 where clockwise; over shared edges these add up.
    pub k: i32,
    /// [`COUNT_IN_FRONT`], or 0; and twice the number of what the volume belongs to (a triangle, a body), by which its
    /// limits are found.
    pub flags: u32,
}

/// A triangle that closes a volume at both ends. The twin of `Cap` in `volume/geometry.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Cap {
    /// Index of the triangle.
    pub triangle: u32,
    /// +1 where the light sees the corners run counter-clockwise, -1 where clockwise, 0 for no volume; times
    /// the number of volumes.
    pub k: i32,
    /// As [`Side::flags`]; the same for all faces of a volume.
    pub flags: u32,
}

/// Flag: the face is counted if it is in front of the sample (z-pass), not behind it (z-fail). Such volumes have no
/// far cap at infinity.
pub const COUNT_IN_FRONT: u32 = 1;

/// Room for faces, and the indirect draws over them.
///
/// A producer fills the lists and the records in compute or by upload, from the front; what lies beyond the
/// records' counts is not drawn. Faces with k = 0 may stand among the others and cost a vertex.
#[derive(Debug)]
pub struct VolumeFaces {
    /// `array<Side>`, usage `STORAGE`.
    pub sides: wgpu::Buffer,
    /// `array<Cap>`, usage `STORAGE`.
    pub caps: wgpu::Buffer,
    /// Two draw records of four `u32` each (vertices, slices, 0, 0), usage `INDIRECT` and `STORAGE`: sides, then
    /// caps, with [`VolumeFaces::VERTICES`] a face.
    pub draws: wgpu::Buffer,
    /// Sides that there is room for.
    pub side_room: u32,
    /// Caps that there is room for.
    pub cap_room: u32,
}

impl VolumeFaces {
    /// Offset of the record that draws caps, bytes.
    pub const CAP_DRAW: u64 = 16;

    /// Vertices a face: those of two triangles, which make a rectangle around it in the picture.
    pub const VERTICES: u32 = 6;

    /// Room for `sides` sides and `caps` caps.
    ///
    /// # Errors
    /// More than the device takes in one buffer.
    pub fn new(gpu: &Gpu, sides: u32, caps: u32) -> Result<Self, GpuError> {
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let buffer = |label, count: u32, size: usize| {
            let size = u64::from(count.max(1)) * size as u64;
            if size > limit {
                let what = "bytes of shadow-volume faces (split the casters)";
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
        };
        Ok(Self {
            sides: buffer("volume sides", sides, size_of::<Side>())?,
            caps: buffer("volume caps", caps, size_of::<Cap>())?,
            draws: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("volume draws"),
                size: 2 * Self::CAP_DRAW,
                usage: wgpu::BufferUsages::INDIRECT
                    | wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            side_room: sides,
            cap_room: caps,
        })
    }

    /// Whether there is room for one volume a triangle.
    #[must_use]
    pub fn holds(&self, triangles: &CasterTriangles<'_>) -> bool {
        let count = triangles.triangles;
        self.cap_room >= count && u64::from(self.side_room) >= 3 * u64::from(count)
    }

    /// Uploads the draw records, where their counts are known on the CPU.
    pub fn set_draws(&self, gpu: &Gpu, sides: u32, caps: u32, slices: u32) {
        let [sides, caps] = [sides, caps].map(|count| Self::VERTICES * count);
        let records: [u32; 8] = [sides, slices, 0, 0, caps, slices, 0, 0];
        gpu.queue.write_buffer(&self.draws, 0, bytemuck::cast_slice(&records));
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.sides.size() + self.caps.size() + self.draws.size()
    }
}
