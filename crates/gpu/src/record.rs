//! Passes with timestamps.

use std::cell::Cell;

use crate::{Gpu, GpuError, readback::read_buffer};

/// GPU time of one pass.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// The pass's name (`map/depth`).
    pub name: &'static str,
    /// Milliseconds between its begin and its end.
    pub ms: f64,
}

/// GPU times of one recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassTimes {
    /// Each pass in the order of recording.
    pub passes: Vec<PassTime>,
}

impl PassTimes {
    /// Sum over all passes, milliseconds.
    #[must_use]
    pub fn total_ms(&self) -> f64 {
        self.passes.iter().map(|p| p.ms).sum()
    }
}

/// Timestamp queries for up to a fixed number of passes.
///
/// Time is taken around whole passes only: inside a pass it means nothing on tilers and on software
/// devices.
#[derive(Debug)]
pub struct Timer {
    queries: wgpu::QuerySet,
    resolve: wgpu::Buffer,
    capacity: u32,
    names: Vec<&'static str>,
    overflow: Cell<bool>,
}

impl Timer {
    /// A timer for up to `passes` passes a recording, or `None` where the device has no timestamps:
    /// measure the wall clock around a submission instead.
    #[must_use]
    pub fn new(gpu: &Gpu, passes: u32) -> Option<Self> {
        if !gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let count = (2 * passes).min(wgpu::QUERY_SET_MAX_QUERIES);
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("pass times"),
            ty: wgpu::QueryType::Timestamp,
            count,
        });
        let resolve = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("pass times"),
            size: u64::from(count) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Some(Self {
            queries,
            resolve,
            capacity: count / 2,
            names: Vec::new(),
            overflow: Cell::new(false),
        })
    }

    /// Records the copy of the timestamps; call it after the last pass and before the submission.
    pub fn finish(&self, encoder: &mut wgpu::CommandEncoder) {
        if !self.names.is_empty() {
            let count = 2 * self.names.len() as u32;
            encoder.resolve_query_set(&self.queries, 0..count, &self.resolve, 0);
        }
    }

    /// Waits for the submission and gives the times; the timer is then ready for the next recording.
    ///
    /// # Errors
    /// A lost device, or more passes than the timer has room for.
    pub fn read(&mut self, gpu: &Gpu) -> Result<PassTimes, GpuError> {
        let names = std::mem::take(&mut self.names);
        if self.overflow.replace(false) {
            return Err(GpuError::Limit {
                what: "passes of one timed recording",
                asked: u64::from(self.capacity) + 1,
                limit: self.capacity.into(),
            });
        }
        if names.is_empty() {
            return Ok(PassTimes::default());
        }
        let bytes = read_buffer(gpu, &self.resolve, names.len() as u64 * 16)?;
        let ticks: &[u64] = bytemuck::cast_slice(&bytes);
        let ms_per_tick = f64::from(gpu.queue.get_timestamp_period()) * 1e-6;
        let passes = names
            .into_iter()
            .zip(ticks.chunks_exact(2))
            .map(|(name, t)| PassTime { name, ms: t[1].saturating_sub(t[0]) as f64 * ms_per_tick })
            .collect();
        Ok(PassTimes { passes })
    }

    /// The indices for the next pass, or `None` when the timer is full.
    fn next(&mut self, name: &'static str) -> Option<(u32, u32)> {
        if self.names.len() as u32 == self.capacity {
            self.overflow.set(true);
            return None;
        }
        let first = 2 * self.names.len() as u32;
        self.names.push(name);
        Some((first, first + 1))
    }
}

/// The caller's encoder, with a timer when passes are to be timed.
#[derive(Debug)]
pub struct Recorder<'a> {
    /// The caller's encoder.
    pub encoder: &'a mut wgpu::CommandEncoder,
    timer: Option<&'a mut Timer>,
}

impl<'a> Recorder<'a> {
    /// Records without times.
    pub fn new(encoder: &'a mut wgpu::CommandEncoder) -> Self {
        Self { encoder, timer: None }
    }

    /// Records with times where there is a timer.
    pub fn timed(encoder: &'a mut wgpu::CommandEncoder, timer: Option<&'a mut Timer>) -> Self {
        Self { encoder, timer }
    }

    /// Begins a depth-only pass into `depth`, cleared to `clear`.
    pub fn depth_pass(
        &mut self,
        name: &'static str,
        depth: &wgpu::TextureView,
        clear: f32,
    ) -> wgpu::RenderPass<'_> {
        self.render_pass(name, &[], Some(depth_attachment(depth, clear)))
    }

    /// Begins a render pass.
    pub fn render_pass<'p>(
        &'p mut self,
        name: &'static str,
        color_attachments: &[Option<wgpu::RenderPassColorAttachment<'_>>],
        depth_stencil_attachment: Option<wgpu::RenderPassDepthStencilAttachment<'_>>,
    ) -> wgpu::RenderPass<'p> {
        let query = self.timer.as_deref_mut().and_then(|t| t.next(name).map(|q| (&t.queries, q)));
        self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(name),
            color_attachments,
            depth_stencil_attachment,
            timestamp_writes: query.map(|(query_set, (begin, end))| {
                wgpu::RenderPassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(begin),
                    end_of_pass_write_index: Some(end),
                }
            }),
            ..Default::default()
        })
    }

    /// Begins a compute pass.
    pub fn compute_pass(&mut self, name: &'static str) -> wgpu::ComputePass<'_> {
        let query = self.timer.as_deref_mut().and_then(|t| t.next(name).map(|q| (&t.queries, q)));
        self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(name),
            timestamp_writes: query.map(|(query_set, (begin, end))| {
                wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(begin),
                    end_of_pass_write_index: Some(end),
                }
            }),
        })
    }
}

/// A depth attachment that is cleared to `clear` and kept.
pub(crate) fn depth_attachment(
    view: &wgpu::TextureView,
    clear: f32,
) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations {
            load: wgpu::LoadOp::Clear(clear),
            store: wgpu::StoreOp::Store,
        }),
        stencil_ops: None,
    }
}
