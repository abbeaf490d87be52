//! The least and the largest depth of squares of any size, from an N-buffer.

use antumbra_gpu::{
    Anchor, Beyond, BlurShader, Counters, Frame, Gpu, GpuError, LayerJob, Pyramid, PyramidKind,
    Recorder,
};
use antumbra_map::{ShadowMap, Store};
use antumbra_shaders::module;

use crate::beside::Depth;

/// N-buffers (Décoret 2005) of a map's least and largest depths: a level for each power of two that a window's side may
/// have, at every texel.
#[derive(Debug)]
pub(crate) struct Ranges {
    pyramid: Pyramid,
    jobs: Vec<LayerJob>,
    depth: Depth,
}

impl Ranges {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = BlurShader {
            texel: "filter::from_depth",
            mean: "gpu::mean::min_max",
            slots: vec![module("encoding", "filter::encoding::depth_twice")],
            format: wgpu::TextureFormat::Rg32Float,
        };
        let kind = PyramidKind::NBuffer(Anchor::Corner, Beyond::Repeat);
        let pyramid = Pyramid::new(gpu, kind, &shader)?;
        Ok(Self { pyramid, jobs: Vec::new(), depth: Depth::new(gpu, false) })
    }
}

impl Store for Ranges {
    fn prepare(&mut self, gpu: &Gpu, _frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.jobs.clear();
        self.depth.prepare(gpu, map.view())?;
        let Some(view) = map.view() else { return Ok(()) };
        self.jobs.extend(map.linear_depths().iter().enumerate().map(|(layer, linear)| LayerJob {
            source: layer as u32,
            parameters: [
                linear.coefficients.map(|c| c as f32),
                [0.0, 0.0, 0.0, linear.last_caster as f32],
            ],
        }));
        self.pyramid.prepare(gpu, view, map.size(), &self.jobs)
    }

    fn encode(
        &mut self,
        _gpu: &Gpu,
        _frame: &Frame<'_>,
        _map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        if !self.jobs.is_empty() {
            self.pyramid.encode(recorder, "filter/n-buffer");
        }
        Ok(())
    }

    fn needs_receivers(&self) -> bool {
        true
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(self.depth.layout())
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.depth.group()
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.pyramid.stack_view()
    }

    fn counters(&self) -> Counters {
        let texels = if self.jobs.is_empty() { 0 } else { self.pyramid.texels() };
        // All levels but the first are made of four texels.
        let levels = u64::from(self.pyramid.levels().max(1));
        Counters::from([
            ("store_layers", self.jobs.len() as u64),
            ("store_texels", texels),
            ("store_taps", texels / levels * (4 * levels - 3)),
        ])
    }

    fn bytes(&self) -> u64 {
        self.pyramid.bytes() + self.depth.bytes()
    }
}
