//! How a light's views are arranged: what shaders link, and who fits the views.

use std::any::Any;
use std::fmt;

use antumbra_gpu::{Counters, Frame, Gate, Gpu, GpuError, Recorder};
use antumbra_scene::Light;
use antumbra_shaders::{Slot, module};
use glam::DVec3;

use crate::{Fitting, Resolve, SeenView, ShadowMap, Sight};

/// How casters get into a view of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawing {
    /// By [`antumbra_gpu::Casters::draw`] with the view's matrix: projections that keep lines straight.
    Matrix,
    /// By `map::traced`: each texel is traced along its own ray, so that edges are as curved as the projection
    /// makes them. Needs [`antumbra_gpu::Casters::triangles`].
    Traced,
    /// By `map::warped`: vertices go where the projection takes them, and edges stay straight in between. Needs
    /// [`antumbra_gpu::Casters::triangles`].
    Warped,
    /// By the passes of the arrangement's own [`Refit`], all views into one layer. The layout's `map::shadow` finds the
    /// texels again, and kernels stay among those that surround a sample by the map's guard band.
    Pages,
}

/// A layout: in which view of the map a point lies, and how a view projects.
///
/// Open to other crates: cascades, warped maps and pages are layouts with shader modules of their own, fitted
/// by an [`Arrange`].
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Binding of the slot `layout`, whose `select_view(p)` may look at all views (`map::views::view_at`); and
    /// of `common::projection`, whatever that imports, where views are given by more than a matrix.
    pub slots: Vec<Slot>,
    /// Number of views.
    pub views: usize,
    /// How casters are drawn.
    pub drawing: Drawing,
}

impl Layout {
    /// One view: directional and spot lights.
    #[must_use]
    pub fn single() -> Self {
        Self::of_matrices("map::layout_single", 1)
    }

    /// Six views, one an axis direction, around a position: +x, -x, +y, -y, +z, -z.
    #[must_use]
    pub fn cube() -> Self {
        Self::of_matrices("map::layout_cube", 6)
    }

    /// `views` views given by their matrices, of which the shader module `path` selects one.
    #[must_use]
    pub fn of_matrices(path: &'static str, views: usize) -> Self {
        Self { slots: vec![module("layout", path)], views, drawing: Drawing::Matrix }
    }

    /// The layout that serves a light by default: one view for directional and spot lights, a cube for the
    /// others.
    #[must_use]
    pub fn of(light: &Light) -> Self {
        match light {
            Light::Directional { .. } | Light::Spot { .. } => Self::single(),
            _ => Self::cube(),
        }
    }
}

/// Chooses a layout for a light and fits its views; [`crate::Omni`] is the ready-made one.
pub trait Arrange: fmt::Debug {
    /// The layout under `light`. Where it changes, passes are compiled anew.
    fn layout(&self, light: &Light) -> Layout;

    /// The views of the frame's light, as many as its layout has, for casters whose convex hull is that of
    /// `hull` (world space), of which only those count that can shadow something in `sight`, where that is known.
    ///
    /// # Errors
    /// A frame that cannot be served.
    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError>;

    /// How far aside of the direction to `light` an estimator looks that these views are for, as the tangent of the angle:
    /// metres across a metre along parallel light; 0, by default, where it looks at the kernel around a point alone.
    fn spread(&self, light: &Light) -> f64 {
        let _ = light;
        0.0
    }

    /// What fits the views anew on the GPU, for `light`, from what only the GPU knows; nothing by default.
    ///
    /// # Errors
    /// A shader that does not link.
    fn refit(&self, gpu: &Gpu, light: &Light) -> Result<Option<Box<dyn Refit>>, GpuError> {
        let _ = (gpu, light);
        Ok(None)
    }
}

/// Passes that write matrices over those that [`Arrange::fit`] gave, before the map is drawn. What they do not know of
/// is left as it was fitted: half-spaces for culling, linear depth, the views that have a layer. Those of
/// [`Drawing::Pages`] draw the map, too.
pub trait Refit: fmt::Debug + Any {
    /// Uploads for a frame whose views `map` has fitted.
    ///
    /// # Errors
    /// A frame that cannot be served.
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError>;

    /// Layout of what the layout's own modules read: bind group 3 of the lookup, seen by the compute stage. The same at all
    /// times; nothing by default.
    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        None
    }

    /// The bind group of that layout for the frame that was last prepared.
    fn group(&self) -> Option<&wgpu::BindGroup> {
        None
    }

    /// Work of the last [`Refit::encode`]; none by default, where it is little.
    fn counters(&self) -> Counters {
        Counters::new()
    }

    /// As [`Refit::counters`], with what only the GPU knows. Waits.
    ///
    /// # Errors
    /// A lost device.
    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let _ = gpu;
        Ok(self.counters())
    }

    /// Records the passes. They write the matrices both into the views that `resolve` looks up
    /// ([`Resolve::views`]) and into those that the map is drawn by ([`ShadowMap::matrices`]).
    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        resolve: &Resolve,
        recorder: &mut Recorder<'_>,
    );

    /// Says whether the frame's passes draw any texel of the map, where texels are kept from frame to frame; nothing by default.
    fn drawn(&self) -> Option<Gate> {
        None
    }

    /// Whether casters are to be chosen on the GPU by the windows of what is fitted, default no.
    fn culls(&self) -> bool {
        false
    }

    /// Bytes of GPU memory held.
    fn bytes(&self) -> u64;
}
