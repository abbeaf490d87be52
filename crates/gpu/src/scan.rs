//! Prefix sums on the GPU: where each of many threads may write, in an order that does not depend on which
//! thread comes first (Blelloch 1990; *GPU Gems 3*, chapter 39).
//!
//! Blocks of values are summed in workgroup memory, the sums of the blocks likewise, and so on; then each
//! block adds what stands before it.

use crate::{Gpu, GpuError, bind, entries};

/// Values that a workgroup sums; `gpu/scan.wesl` knows it too.
const BLOCK: u32 = 1024;

/// Replaces each value of a buffer by the sum of those before it (modulo 2^32).
///
/// Of one value more than there are, whatever it is, becomes the sum of all.
#[derive(Debug)]
pub struct Scan {
    sum: wgpu::ComputePipeline,
    add: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    made_for: Option<(wgpu::Buffer, u32)>,
    levels: Vec<Level>,
}

/// Blocks of one level, with the buffer of their sums, which are the values of the next.
#[derive(Debug)]
struct Level {
    group: wgpu::BindGroup,
    blocks: u32,
    sums: wgpu::Buffer,
}

impl Scan {
    /// Builds the passes.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("scan"),
            entries: &[entries::write_storage(0, CS), entries::write_storage(1, CS)],
        });
        let module = gpu.shader("scan", antumbra_shaders::link("gpu::scan", &[])?);
        let pipeline = |entry| gpu.compute_pipeline("scan", &module, entry, &[&layout]);
        let (sum, add) = (pipeline("sum_blocks"), pipeline("add_sums"));
        Ok(Self { sum, add, layout, made_for: None, levels: Vec::new() })
    }

    /// Makes room for scanning the first `count` values of `values` (`u32`, usage `STORAGE`). Allocates nothing
    /// when both are those of the last call.
    ///
    /// # Errors
    /// More values than one dispatch takes.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        values: &wgpu::Buffer,
        count: u32,
    ) -> Result<(), GpuError> {
        if self.made_for.as_ref().is_some_and(|(b, n)| b == values && *n == count) {
            return Ok(());
        }
        let groups = gpu.device.limits().max_compute_workgroups_per_dimension;
        let limit = u64::from(groups) * u64::from(BLOCK);
        if u64::from(count) > limit {
            return Err(GpuError::Limit { what: "values to sum", asked: count.into(), limit });
        }
        self.levels.clear();
        let (mut from, mut left) = (values.clone(), count);
        while left > 0 {
            let blocks = left.div_ceil(BLOCK);
            let sums = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("sums of blocks"),
                size: u64::from(blocks) * 4,
                usage: wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            });
            let size = wgpu::BufferSize::new(u64::from(left) * 4);
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("scan"),
                layout: &self.layout,
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                            buffer: &from,
                            offset: 0,
                            size,
                        }),
                    },
                    bind::buffer(1, &sums),
                ],
            });
            self.levels.push(Level { group, blocks, sums: sums.clone() });
            // The sum of the one last block is nobody's.
            (from, left) = (sums, if blocks > 1 { blocks } else { 0 });
        }
        self.made_for = Some((values.clone(), count));
        Ok(())
    }

    /// Records the sums into a compute pass.
    pub fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(&self.sum);
        for level in &self.levels {
            pass.set_bind_group(0, &level.group, &[]);
            pass.dispatch_workgroups(level.blocks, 1, 1);
        }
        pass.set_pipeline(&self.add);
        for level in self.levels.iter().rev().filter(|level| level.blocks > 1) {
            pass.set_bind_group(0, &level.group, &[]);
            pass.dispatch_workgroups(level.blocks, 1, 1);
        }
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.levels.iter().map(|level| level.sums.size()).sum()
    }
}
