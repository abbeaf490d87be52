//! The contract between a frame, its casters and a shadow technique.

use std::collections::BTreeMap;

use antumbra_scene::Light;
use glam::{DMat4, DVec3, Mat4};

use crate::{Expectation, Gpu, GpuError, Recorder, ViewSamples};

/// Deterministic work counters, by name: texels, draws, triangles, tiles, fetches, bytes.
pub type Counters = BTreeMap<&'static str, u64>;

/// What a technique is given each frame.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    /// What the camera sees, relative to `origin`.
    pub samples: &'a ViewSamples,
    /// The camera that sees them, or `None` where they are points of another kind; techniques that draw
    /// from the camera then refuse, and those that fit to what is in view fit to all casters.
    pub camera: Option<ViewCamera>,
    /// The light, in world space.
    pub light: &'a Light,
    /// What casts shadows.
    pub casters: &'a dyn Casters,
    /// World position of the zero of all `f32` positions, metres.
    pub origin: DVec3,
}

/// The camera behind view samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewCamera {
    /// Points relative to the frame's origin to clip space: any perspective or orthographic projection,
    /// forward or reversed, finite or infinite.
    pub clip: DMat4,
    /// Position of the eye relative to the frame's origin, metres.
    pub eye: DVec3,
}

/// A shadow technique: from a frame to visibility.
pub trait Technique {
    /// Fits, allocates and uploads for `frame`. Allocates nothing when sizes are those of the last
    /// call.
    ///
    /// # Errors
    /// A frame that the technique cannot serve, or a failed allocation.
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError>;

    /// Records the technique's passes; `visibility` is an `R32Float` storage view of the samples'
    /// size that receives 1 where the light is fully visible and 0 where it is hidden. Call
    /// [`Technique::prepare`] with the same frame first.
    ///
    /// # Errors
    /// A frame that was not prepared.
    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError>;

    /// Work of the last [`Technique::encode`].
    fn counters(&self) -> Counters;

    /// Bytes of GPU memory held.
    fn bytes(&self) -> u64;
}

/// A view of the light into which casters are drawn.
#[derive(Clone, Copy)]
pub struct LightView<'a> {
    /// Points relative to the frame's origin to clip space of the light.
    pub clip: Mat4,
    /// Group 0 of [`light_view_layout`], holding `clip`.
    pub bind_group: &'a wgpu::BindGroup,
    /// Its dynamic offset.
    pub offset: u32,
    /// Format of the depth attachment.
    pub format: wgpu::TextureFormat,
    /// +1 where larger depth is farther, -1 for reversed depth.
    pub order: f32,
    /// The light, in world space.
    pub light: &'a Light,
    /// World position of the zero of all `f32` positions, metres.
    pub origin: DVec3,
}

/// What one call of [`Casters::draw`] drew.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drawn {
    /// Draw calls.
    pub draws: u64,
    /// Triangles.
    pub triangles: u64,
}

/// Geometry that casts shadows. An application implements it for its own meshes (skinned,
/// procedural, instanced); [`crate::MeshSet`] is a ready-made one.
pub trait Casters {
    /// Calls `visit` with points (world space, metres) whose convex hull contains every caster that
    /// can shadow something under `light`. Without a caster there is no call.
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3));

    /// Draws depth into `pass`, which has one depth attachment of `view.format` and no colour. The
    /// pass's viewport is the whole layer. Both faces of every triangle are to be drawn.
    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn;

    /// The triangles of all casters, or `None` where the application keeps them to itself: techniques that
    /// need them then refuse.
    fn triangles(&self) -> Option<CasterTriangles<'_>> {
        None
    }
}

/// The triangles of casters, for techniques that need more than their depth.
#[derive(Clone, Copy, Debug)]
pub struct CasterTriangles<'a> {
    /// Positions, three `f32` a vertex without padding, relative to the frame's origin, metres. Usages
    /// `VERTEX` and `STORAGE`.
    pub positions: &'a wgpu::Buffer,
    /// Three `u32` vertex indices a triangle. Usages `INDEX` and `STORAGE`.
    pub indices: &'a wgpu::Buffer,
    /// Number of vertices.
    pub vertices: u32,
    /// Number of triangles.
    pub triangles: u32,
}

/// Layout of [`LightView::bind_group`]: binding 0, a `mat4x4f` uniform with a dynamic offset, seen by
/// the vertex stage.
#[must_use]
pub fn light_view_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("light view"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: wgpu::BufferSize::new(64),
            },
            count: None,
        }],
    })
}

/// The settings of a technique: plain data, whose default is what was published.
pub trait TechniqueConfig {
    /// Checks the settings and builds the technique.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits; the error says the fix.
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError>;

    /// Sets the side of the technique's maps, texels. Without a map there is nothing to set.
    fn set_map_size(&mut self, size: u32) {
        let _ = size;
    }

    /// What theory says of the technique, with these settings and the default bias, on the hard case of that
    /// name (of `antumbra_measure::stability::CASES`); `None` where nobody has said yet.
    fn expectation(&self, case: &str) -> Option<Expectation>;
}
