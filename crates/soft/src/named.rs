//! Triangles that the map's texels name.

use antumbra_gpu::{CasterTriangles, Counters, Frame, Gpu, GpuError, Recorder, bind, entries};
use antumbra_map::{ShadowMap, TriangleNames};

use crate::table::no_texels;

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;

/// Bindings of `soft/named_triangles.wesl`: names, corners, indices.
const BINDINGS: [u32; 3] = [10, 11, 12];

/// The names, drawn together with the map's depths.
#[derive(Debug)]
pub(crate) struct Named {
    names: TriangleNames,
    nothing: wgpu::TextureView,
    is_drawn: bool,
}

/// What the bindings hold.
pub(crate) type Bound = (wgpu::TextureView, [wgpu::Buffer; 2]);

impl Named {
    /// Nothing where no texel's triangle is asked for.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, reach: u32) -> Result<Option<Self>, GpuError> {
        if reach == 0 {
            return Ok(None);
        }
        let nothing = no_texels(gpu, wgpu::TextureFormat::R32Uint)?;
        Ok(Some(Self { names: TriangleNames::new(gpu)?, nothing, is_drawn: false }))
    }

    pub(crate) fn entries() -> [wgpu::BindGroupLayoutEntry; 3] {
        let [names, corners, indices] = BINDINGS;
        [
            entries::unsigned_array(names, CS),
            entries::storage(corners, CS),
            entries::storage(indices, CS),
        ]
    }

    pub(crate) fn bind(bound: &Bound) -> [wgpu::BindGroupEntry<'_>; 3] {
        let ([names, corners, indices], (view, buffers)) = (BINDINGS, bound);
        [
            bind::texture(names, view),
            bind::buffer(corners, &buffers[0]),
            bind::buffer(indices, &buffers[1]),
        ]
    }

    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
    ) -> Result<Bound, GpuError> {
        self.is_drawn = map.view().is_some();
        let CasterTriangles { positions, indices, .. } = self.names.prepare(gpu, frame, map)?;
        let view = self.names.view().unwrap_or(&self.nothing).clone();
        Ok((view, [positions, indices].map(Clone::clone)))
    }

    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        if !self.is_drawn {
            return Ok(());
        }
        self.names.encode(gpu, frame, map, recorder, wgpu::StoreOp::Store)
    }

    pub(crate) fn counters(&self) -> Counters {
        if self.is_drawn { self.names.counters().clone() } else { Counters::new() }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.names.bytes()
    }
}
