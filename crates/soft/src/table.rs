//! Sums of a map's depth, for estimators that read moments of windows.

use antumbra_gpu::{Gpu, GpuError, LayerJob, Recorder, Sat};
use antumbra_map::ShadowMap;

/// A summed-area table of the map's linear depth.
#[derive(Debug)]
pub(crate) struct Table {
    sat: Sat,
    jobs: Vec<LayerJob>,
    /// In its place where there is no map.
    nothing: wgpu::TextureView,
}

impl Table {
    pub(crate) fn new(gpu: &Gpu, sat: Sat) -> Result<Self, GpuError> {
        let nothing = no_texels(gpu, wgpu::TextureFormat::Rg32Uint)?;
        Ok(Self { sat, jobs: Vec::new(), nothing })
    }

    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        map: &ShadowMap,
        is_hard: bool,
    ) -> Result<(), GpuError> {
        self.jobs.clear();
        let Some(view) = map.view().filter(|_| !is_hard) else { return Ok(()) };
        self.jobs.extend(map.linear_depths().iter().enumerate().map(|(layer, linear)| LayerJob {
            source: layer as u32,
            // All that is drawn is kept where it is.
            parameters: [linear.coefficients.map(|c| c as f32), [0.0, 0.0, 0.0, 1.0]],
        }));
        self.sat.prepare(gpu, view, map.size(), &self.jobs)
    }

    pub(crate) fn view(&self) -> &wgpu::TextureView {
        self.sat.view().unwrap_or(&self.nothing)
    }

    pub(crate) fn texels(&self) -> u64 {
        if self.jobs.is_empty() { 0 } else { self.sat.texels() }
    }

    pub(crate) fn encode(&self, recorder: &mut Recorder<'_>) {
        if !self.jobs.is_empty() {
            self.sat.encode(recorder, "soft/sum");
        }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.sat.bytes()
    }
}

/// A texture of one texel, for a binding that nothing reads.
pub(crate) fn no_texels(
    gpu: &Gpu,
    format: wgpu::TextureFormat,
) -> Result<wgpu::TextureView, GpuError> {
    let texture = gpu.create_texture(
        "nothing",
        &wgpu::TextureDescriptor {
            label: Some("nothing"),
            size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        },
    )?;
    Ok(texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    }))
}
