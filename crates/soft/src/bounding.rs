//! Least and greatest depths of windows of a map, layer by layer.

use antumbra_gpu::{
    Anchor, Beyond, BlurShader, Gpu, GpuError, LayerJob, Pyramid, PyramidKind, Recorder, entries,
};
use antumbra_map::ShadowMap;

use crate::table::no_texels;
use crate::window::Hierarchy;

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

/// A pyramid of bounds, for the bindings 1 and 4 of `soft/bounds*.wesl`. Its level 0, where it is not stored, is the map.
#[derive(Debug)]
pub(crate) struct Bounding {
    kind: Hierarchy,
    pyramid: Pyramid,
    jobs: Vec<LayerJob>,
    nothing: wgpu::TextureView,
}

impl Bounding {
    /// Nothing for [`Hierarchy::None`].
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, kind: Hierarchy) -> Result<Option<Self>, GpuError> {
        let (pyramid, texel) = match kind {
            Hierarchy::None => return Ok(None),
            Hierarchy::Mip => (PyramidKind::Mip, "soft::four_texels"),
            Hierarchy::Multiscale => {
                (PyramidKind::NBuffer(Anchor::Corner, Beyond::Repeat), "soft::one_texel")
            }
            // Of the halved map, so that of three levels of a mipmap the map is the first.
            Hierarchy::Y => {
                let (anchor, beyond) = (Anchor::Corner, Beyond::Repeat);
                (PyramidKind::YMap { mips: 2, anchor, beyond }, "soft::four_texels")
            }
        };
        let mean = "gpu::mean::min_max";
        let shader = BlurShader { texel, mean, slots: Vec::new(), format: FORMAT };
        Ok(Some(Self {
            kind,
            pyramid: Pyramid::new(gpu, pyramid, &shader)?,
            jobs: Vec::new(),
            nothing: no_texels(gpu, FORMAT)?,
        }))
    }

    pub(crate) fn entries(&self) -> Vec<wgpu::BindGroupLayoutEntry> {
        let bindings: &[u32] = if self.kind == Hierarchy::Y { &[1, 4] } else { &[1] };
        bindings.iter().map(|binding| entries::texels(*binding, CS, true)).collect()
    }

    /// Makes room for a map, unless it has no casters or `is_hard`.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        map: &ShadowMap,
        is_hard: bool,
    ) -> Result<(), GpuError> {
        self.jobs.clear();
        let Some(view) = map.view().filter(|_| !is_hard) else { return Ok(()) };
        let layers = map.views().iter().filter(|view| view.clip.is_some()).count() as u32;
        self.jobs.extend((0..layers).map(|source| LayerJob { source, ..LayerJob::default() }));
        let size = match self.kind {
            Hierarchy::Multiscale | Hierarchy::None => map.size(),
            Hierarchy::Mip | Hierarchy::Y => (map.size() / 2).max(1),
        };
        self.pyramid.prepare(gpu, view, size, &self.jobs)
    }

    pub(crate) fn encode(&self, recorder: &mut Recorder<'_>) {
        if !self.jobs.is_empty() {
            self.pyramid.encode(recorder, "soft/pyramid");
        }
    }

    /// What the bindings 1 and 4 hold.
    pub(crate) fn views(&self) -> [Option<wgpu::TextureView>; 2] {
        let or_nothing = |view: Option<&wgpu::TextureView>| view.unwrap_or(&self.nothing).clone();
        let (mips, stack) = (self.pyramid.mips_view(), self.pyramid.stack_view());
        match self.kind {
            Hierarchy::Y => [Some(or_nothing(mips)), Some(or_nothing(stack))],
            _ => [Some(or_nothing(mips.or(stack))), None],
        }
    }

    pub(crate) fn texels(&self) -> u64 {
        if self.jobs.is_empty() { 0 } else { self.pyramid.texels() }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.pyramid.bytes()
    }
}
