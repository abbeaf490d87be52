//! The contract between a frame, its casters and a shadow technique.

use std::any::Any;
use std::collections::BTreeMap;
use std::ops::Range;

use antumbra_scene::{Bounds, Light};
use glam::{DMat4, DVec3, DVec4, Mat4};

use crate::{CasterEdges, Expectation, Gpu, GpuError, Recorder, ViewSamples};

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

impl ViewCamera {
    /// Where lines of sight come from: the eye's position and 1, or where they are parallel the unit direction to there
    /// and 0.
    #[must_use]
    pub fn homogeneous_eye(&self) -> DVec4 {
        let rows = self.clip.transpose();
        let [x, y, w] = [rows.x_axis, rows.y_axis, rows.w_axis].map(DVec4::truncate);
        if w != DVec3::ZERO {
            return self.eye.extend(1.0);
        }
        // They lead from the eye's side into the picture, whichever way depth runs.
        let line = x.cross(y).normalize_or_zero();
        let middle = self.clip.inverse() * DVec4::new(0.0, 0.0, 0.5, 1.0);
        let side = line.dot(self.eye - middle.truncate() / middle.w);
        (line * side.signum()).extend(0.0)
    }
}

/// Checks that a light is one.
///
/// # Errors
/// A direction or position that is not finite, a zero direction, or a cone that is not within (0, 90) degrees.
pub fn check_light(light: &Light) -> Result<(), GpuError> {
    let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
    if let Light::Directional { direction, .. } | Light::Spot { direction, .. } = *light
        && !(direction.is_finite() && direction.length_squared() > 0.0)
    {
        let fix = "give a finite direction that is not zero";
        return invalid("direction of the light", direction.to_string(), fix);
    }
    if let Some(position) = light.position()
        && !position.is_finite()
    {
        let fix = "give a finite position";
        return invalid("position of the light", position.to_string(), fix);
    }
    if let Light::Spot { outer_angle, .. } = *light
        && !(outer_angle > 0.0 && outer_angle < std::f64::consts::FRAC_PI_2)
    {
        let fix = "use a half angle between 0 and 90 degrees, or a point light";
        return invalid("outer angle of the spot light", outer_angle.to_string(), fix);
    }
    Ok(())
}

/// A shadow technique: from a frame to visibility.
///
/// It is [`Any`], so that what builds on a technique of a certain kind (cascades on any over a shadow map) finds out
/// what it was given.
pub trait Technique: Any {
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

    /// Work of the last [`Technique::encode`], as far as the CPU knows it.
    fn counters(&self) -> Counters;

    /// As [`Technique::counters`], with what only the GPU knows of the last submitted frame (sizes of lists
    /// that it made itself). Waits: for tests and measurements.
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
    /// Half-spaces (xyz inward unit normal, w offset; points relative to the frame's origin). A caster that lies
    /// wholly outside of one of them need not be drawn: it shadows nothing that is looked up.
    pub volume: &'a [DVec4],
    /// Whether surfaces that receive shadows and cast none are to be drawn too: where maps are averaged, what is not
    /// there counts as infinitely far (Eisemann, Schwarz, Assarsson, Wimmer 2011, section 5.3.6).
    pub receivers: bool,
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

    /// Calls `visit` with every body, whether it can shadow something or not, and returns whether these are all that
    /// view samples may lie on. Where they are, views are fitted to what the camera sees of them, and what cannot
    /// shadow that is left out. By default there is no call and the answer is no: shadows are cast everywhere, all
    /// casters are drawn, and techniques that look for floors, or for casters one by one, find none.
    fn bodies(&self, visit: &mut dyn FnMut(&CasterBody<'_>)) -> bool {
        let _ = visit;
        false
    }

    /// Draws depth into `pass`, which has one depth attachment of `view.format` and no colour. The
    /// pass's viewport is the whole layer. Both faces of every triangle are to be drawn.
    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn;

    /// The triangles of all casters, or `None` where the application keeps them to itself: techniques that
    /// need them then refuse. Triangles with holes are given whole, and such techniques shadow them as whole ones.
    fn triangles(&self) -> Option<CasterTriangles<'_>> {
        None
    }

    /// The casters that let a part of the light through, or `None`, as by default, where there are none. All other answers
    /// are of opaque casters alone, and view samples are to lie on those.
    fn translucent(&self) -> Option<TranslucentTriangles<'_>> {
        None
    }

    /// The edges of [`Casters::triangles`], for techniques that extrude silhouettes: [`CasterEdges`] made once
    /// and kept as long as the indices stay the same. `None` where nobody made them: such techniques then refuse.
    ///
    /// # Errors
    /// More data than the device takes in one buffer.
    fn edges(&self, gpu: &Gpu) -> Result<Option<&CasterEdges>, GpuError> {
        let _ = gpu;
        Ok(None)
    }

    /// The clusters among which a technique may choose on the GPU what to draw, made when first asked for; `None`, as by
    /// default, where there are none: then all that [`Casters::draw`] draws is drawn. Who has some implements
    /// [`Casters::kept_clusters`] and [`Casters::draw_listed`] too.
    fn clusters(&self, gpu: &Gpu) -> Option<CasterClusters<'_>> {
        let _ = gpu;
        None
    }

    /// Calls `visit` with ranges of clusters, by number, that can shadow something in `view`: those that
    /// [`Casters::draw`] draws.
    fn kept_clusters(&self, view: &LightView<'_>, visit: &mut dyn FnMut(Range<u32>)) {
        let _ = (view, visit);
    }

    /// As [`Casters::draw`], but what is listed. Gives the number of draw calls.
    fn draw_listed(
        &self,
        view: &LightView<'_>,
        list: &ListedTriangles<'_>,
        pass: &mut wgpu::RenderPass<'_>,
    ) -> u64 {
        let _ = (view, list, pass);
        0
    }

    /// Calls `visit` with the ranges of [`Casters::triangles`], counted in triangles, that can shadow
    /// something in `view`: those that [`Casters::draw`] draws. All of them by default.
    fn ranges(&self, view: &LightView<'_>, visit: &mut dyn FnMut(Range<u32>)) {
        let _ = view;
        if let Some(all) = self.triangles() {
            visit(0..all.triangles);
        }
    }
}

/// Casters' triangles in clusters of neighbours, for choosing among them on the GPU.
#[derive(Clone, Copy, Debug)]
pub struct CasterClusters<'a> {
    /// Eight words a cluster: the low corner of its box (`f32`, relative to the frame's origin, metres), the number of its
    /// first index, the high corner, the number of its indices, with bit 31 set where its triangles have holes. The
    /// boxes hold all their vertices. Usage `STORAGE`.
    pub clusters: &'a wgpu::Buffer,
    /// The indices that they refer to. Usage `STORAGE`.
    pub indices: &'a wgpu::Buffer,
    /// Number of clusters.
    pub count: u32,
    /// Number of indices of all clusters.
    pub indices_count: u32,
    /// Number of indices of whole triangles: in a list of chosen ones, those with holes begin there.
    pub holes: u32,
}

/// Triangles chosen on the GPU.
#[derive(Clone, Copy, Debug)]
pub struct ListedTriangles<'a> {
    /// Their indices: those of whole triangles from 0, those with holes from [`CasterClusters::holes`].
    pub indices: &'a wgpu::Buffer,
    /// Two indexed indirect draws, of whole triangles and of those with holes.
    pub draws: &'a wgpu::Buffer,
    /// Where they begin, bytes.
    pub offset: u64,
}

/// What [`Casters::bodies`] says of one body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CasterBody<'a> {
    /// World-space box, metres.
    pub bounds: Bounds,
    /// Boxes of its parts, world space, metres, that together hold it. The smaller they are, the more of a map goes to
    /// casters that matter; `bounds` alone will do.
    pub parts: &'a [Bounds],
    /// For a flat body that bounds the scene, its plane in world space: xyz unit normal, w offset in metres;
    /// no other body reaches below it.
    pub floor: Option<DVec4>,
}

impl CasterBody<'_> {
    /// Whether it can shadow something under `light`. A floor cannot whose upper side is lit: whatever it could shadow
    /// lies below it, and there is nothing.
    #[must_use]
    pub fn can_cast(&self, light: &Light) -> bool {
        !self.floor.is_some_and(|floor| match *light {
            // A wide sun that dips below the floor's plane still only lights it from behind.
            Light::Directional { direction, .. } => direction.dot(floor.truncate()) <= 0.0,
            _ => light.position().is_some_and(|p| p.dot(floor.truncate()) + floor.w >= 0.0),
        })
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
    /// One `u32` a triangle: the number of the object it belongs to, below 2^24. Usage `STORAGE`.
    pub objects: &'a wgpu::Buffer,
    /// Number of vertices.
    pub vertices: u32,
    /// Number of triangles.
    pub triangles: u32,
}

/// The triangles of translucent casters, with their textures.
#[derive(Clone, Copy, Debug)]
pub struct TranslucentTriangles<'a> {
    /// The triangles.
    pub triangles: CasterTriangles<'a>,
    /// Three words a vertex: its texture coordinates (`f32`) and the number of its triangles' texture. Usage `STORAGE`.
    pub coordinates: &'a wgpu::Buffer,
    /// Textures as `Cutout` of `gpu/cutout.wesl` has them; in place of the cutoff what alpha in [0, 1] is multiplied by.
    /// Usage `STORAGE`.
    pub textures: &'a wgpu::Buffer,
    /// Alpha in 1/255, four texels a word. Usage `STORAGE`.
    pub texels: &'a wgpu::Buffer,
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

impl<T: TechniqueConfig + ?Sized> TechniqueConfig for Box<T> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        (**self).build(gpu)
    }

    fn set_map_size(&mut self, size: u32) {
        (**self).set_map_size(size);
    }

    fn map_size(&self) -> Option<u32> {
        (**self).map_size()
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        (**self).expectation(case)
    }
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

    /// The side of the technique's maps, texels, where others build on it and must know; by default they need not.
    fn map_size(&self) -> Option<u32> {
        None
    }

    /// What theory says of the technique, with these settings and the default bias, on the hard case of that
    /// name (of `antumbra_measure::stability::CASES`); `None` where nobody has said yet.
    fn expectation(&self, case: &str) -> Option<Expectation>;
}
