//! What a texel keeps, where that is more than depth.

use antumbra_gpu::{Counters, Frame, Gpu, GpuError, Recorder};

use crate::ShadowMap;

/// Something made of a shadow map's depth, which an estimator reads in the map's place: moments,
/// exponentials, pyramids, tables.
///
/// [`crate::MapTechnique`] records it between the depth passes and the resolve pass. A store has at least one
/// layer for each layer of the map, of the map's size (`map::resolve` takes the size of a layer from what
/// it reads), and its texture suits [`crate::Estimator::read`]. Numbers per view that it needs beside
/// the projection are in the view itself: [`crate::LinearDepth`] is, in the shader `view.linear` and
/// `at.linear`, and here, layer by layer, [`ShadowMap::linear_depths`]. Constants of the technique are
/// linked into both of its shaders as generated source.
pub trait Store: std::fmt::Debug {
    /// Allocates for a map that was prepared for `frame`, and uploads. Allocates nothing when the map is that
    /// of the last call; a map without a layer needs no store.
    ///
    /// # Errors
    /// A failed allocation, or a frame that the store cannot serve.
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError>;

    /// Records the passes that make the store of the map's depth.
    ///
    /// # Errors
    /// A frame that was not prepared.
    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError>;

    /// Whether the store averages depth and so needs every surface in the map, those that cast no shadow too.
    fn needs_receivers(&self) -> bool {
        false
    }

    /// Texels of the map that the largest of the store stands for, a side: windows that follow the camera move in multiples of
    /// them, so that the store's texels stand still in the world as the map's do.
    fn grid(&self) -> u32 {
        1
    }

    /// Whether the store draws the casters itself. Then the map's own depth passes are left out, and its layers
    /// are the store's to use.
    fn draws(&self) -> bool {
        false
    }

    /// Layout of what the estimator reads beside the map, if anything: bind group 2 of its shader, seen by the
    /// compute stage. The same at all times.
    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        None
    }

    /// The bind group of that layout for the frame that was last prepared.
    fn group(&self) -> Option<&wgpu::BindGroup> {
        None
    }

    /// What the estimator reads, as a `D2Array` view, or `None` before the first map with a caster.
    fn view(&self) -> Option<&wgpu::TextureView>;

    /// Work of the last [`Store::encode`].
    fn counters(&self) -> Counters;

    /// As [`Store::counters`], with what only the GPU knows. Waits.
    ///
    /// # Errors
    /// A lost device.
    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let _ = gpu;
        Ok(self.counters())
    }

    /// Bytes of GPU memory held.
    fn bytes(&self) -> u64;
}
