//! Surfaces behind those that the light's centre sees.

use antumbra_gpu::{Counters, Frame, Gpu, GpuError, Recorder, entries};
use antumbra_map::{DepthPeel, ShadowMap};

use crate::table::no_texels;

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;

/// Bindings of `soft/deeper.wesl`.
pub(crate) const BINDINGS: [u32; 3] = [5, 6, 7];

/// The second to fourth layer of a map, peeled.
#[derive(Debug)]
pub(crate) struct Deeper {
    peel: DepthPeel,
    nothing: wgpu::TextureView,
    is_drawn: bool,
}

impl Deeper {
    /// Nothing for one layer.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, layers: u32) -> Result<Option<Self>, GpuError> {
        if layers < 2 {
            return Ok(None);
        }
        let peel = DepthPeel::new(gpu, layers - 1)?;
        let nothing = no_texels(gpu, ShadowMap::FORMAT)?;
        Ok(Some(Self { peel, nothing, is_drawn: false }))
    }

    pub(crate) fn entries() -> impl Iterator<Item = wgpu::BindGroupLayoutEntry> {
        BINDINGS.into_iter().map(|binding| entries::texels(binding, CS, true))
    }

    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
    ) -> Result<(), GpuError> {
        self.is_drawn = !frame.light.is_hard() && map.view().is_some();
        if self.is_drawn { self.peel.prepare(gpu, frame, map) } else { Ok(()) }
    }

    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        if self.is_drawn { self.peel.encode(gpu, frame, map, recorder) } else { Ok(()) }
    }

    /// What the bindings hold.
    pub(crate) fn views(&self) -> [wgpu::TextureView; 3] {
        let layer = |i| self.peel.layer(i).map_or(&self.nothing, |(_, view)| view).clone();
        [layer(0), layer(1), layer(2)]
    }

    pub(crate) fn counters(&self) -> Counters {
        if self.is_drawn { self.peel.counters().clone() } else { Counters::new() }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.peel.bytes()
    }
}
