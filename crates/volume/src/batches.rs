//! Boxes around batches of casters' triangles, by which samples that ask triangles find those worth asking.

use antumbra_gpu::{CasterTriangles, Gpu, GpuError, Recorder, read_buffer};
use glam::Vec4;

use crate::receivers::storage;
use crate::triangles::TrianglePass;

/// Triangles of a batch; `volume/batch.wesl` knows it too.
const BATCH: u32 = 64;
/// Bytes of a box.
const BOX: u64 = 32;

/// The pass that makes the boxes, each frame, since vertices may move; `volume/batches.wesl`.
#[derive(Debug)]
pub(crate) struct Batches {
    pass: TrianglePass,
    boxes: wgpu::Buffer,
    asked: wgpu::Buffer,
    /// Whether every batch is asked.
    all: bool,
}

impl Batches {
    /// Builds the pass; with `all`, nothing is spared.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, all: bool) -> Result<Self, GpuError> {
        let root = "volume::batches";
        Ok(Self {
            pass: TrianglePass::new(gpu, "volume/batches", root, "gather_batches", 1)?,
            boxes: storage(gpu, "batches", BOX)?,
            asked: storage(gpu, "batches asked", 4)?,
            all,
        })
    }

    /// Uploads what the pass needs to know, and makes room for the boxes.
    ///
    /// # Errors
    /// A failed allocation.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        triangles: u32,
        light: Vec4,
    ) -> Result<(), GpuError> {
        let size = BOX * u64::from(triangles.div_ceil(BATCH));
        if self.boxes.size() < size {
            self.boxes = storage(gpu, "batches", size)?;
        }
        self.pass.prepare(gpu, triangles, light, Vec4::ZERO, self.all.into());
        Ok(())
    }

    /// Records the pass.
    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
    ) {
        recorder.encoder.clear_buffer(&self.asked, 0, None);
        self.pass.encode(gpu, recorder, triangles, &[&self.boxes]);
    }

    /// The boxes, and the counter of those that were asked.
    pub(crate) fn buffers(&self) -> [&wgpu::Buffer; 2] {
        [&self.boxes, &self.asked]
    }

    /// How many batches the tiles of the last submitted frame asked, all together. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub(crate) fn read_asked(&self, gpu: &Gpu) -> Result<u64, GpuError> {
        let bytes = read_buffer(gpu, &self.asked, 4)?;
        Ok(bytemuck::pod_read_unaligned::<u32>(&bytes).into())
    }

    /// Bytes of GPU memory held.
    pub(crate) fn bytes(&self) -> u64 {
        self.boxes.size() + self.asked.size()
    }
}
