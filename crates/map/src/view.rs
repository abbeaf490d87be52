//! One projection of a shadow map, as shaders see it.

use antumbra_gpu::SUBPIXEL_STEP;
use glam::{DMat4, DVec4};

use crate::{Bias, Estimator, LinearDepth};

/// How a depth map stores depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthConvention {
    /// Near is 1 and far is 0.
    pub reversed: bool,
    /// Step of the stored depth: 2^-24 for 24-bit, 2^-16 for 16-bit, 0 for 32-bit float, whose rounding is relative
    /// and counted with the rasteriser's.
    pub step: f32,
}

impl DepthConvention {
    /// What [`crate::ShadowMap`] draws: reversed 32-bit float.
    pub const REVERSED_F32: Self = Self { reversed: true, step: 0.0 };

    /// +1 where larger depth is farther from the light, -1 for reversed depth.
    #[must_use]
    pub fn order(self) -> f32 {
        if self.reversed { -1.0 } else { 1.0 }
    }

    /// The depth that means "nothing here".
    #[must_use]
    pub fn clear(self) -> f32 {
        if self.reversed { 0.0 } else { 1.0 }
    }

    /// The depth of the near end.
    #[must_use]
    pub(crate) fn nearest(self) -> f64 {
        if self.reversed { 1.0 } else { 0.0 }
    }

    /// The comparison under which a reference is lit against a stored depth.
    #[must_use]
    pub fn compare(self) -> wgpu::CompareFunction {
        if self.reversed {
            wgpu::CompareFunction::GreaterEqual
        } else {
            wgpu::CompareFunction::LessEqual
        }
    }
}

/// One projection into one layer of a shadow map; the layout of `ShadowView` in `common/lookup.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct ShadowView {
    clip: [[f32; 4]; 4],
    light: [f32; 4],
    depth: [f32; 4],
    bias: [f32; 4],
    offset: [f32; 4],
    linear: [f32; 4],
    range: [f32; 4],
}

impl ShadowView {
    /// A view given by its matrix `clip` ([`crate::FittedView::clip`]), the light
    /// (xyz position relative to the origin and w = 1, or unit direction towards the light and w = 0) and
    /// its `layer` in the map.
    #[must_use]
    pub fn new(
        clip: &DMat4,
        light: DVec4,
        layer: u32,
        convention: DepthConvention,
        bias: &Bias,
        estimator: &Estimator,
    ) -> Self {
        let reach = if bias.receiver_plane { estimator.reach } else { estimator.radius };
        let plane = if bias.receiver_plane { 1.0 } else { 0.0 };
        Self {
            clip: clip.as_mat4().to_cols_array_2d(),
            light: light.as_vec4().to_array(),
            depth: [convention.order(), convention.step, plane, layer as f32],
            bias: [
                bias.constant,
                bias.slope * (reach + SUBPIXEL_STEP),
                bias.cone,
                // A bilinear fetch at the fraction a has a weighted mean distance of 2 a (1 - a) <= 1/2
                // an axis from its four texels.
                0.5 * estimator.reach,
            ],
            offset: [bias.metres, bias.normal, 0.0, 0.0],
            linear: [0.0; 4],
            range: [0.0; 4],
        }
    }

    /// The same view with linear depth, for estimators that read a filterable store.
    #[must_use]
    pub fn with_linear(self, depth: &LinearDepth) -> Self {
        Self {
            linear: depth.coefficients.map(|c| c as f32),
            range: [depth.last as f32, depth.last_caster as f32, 0.0, 0.0],
            ..self
        }
    }

    /// A view into which no caster falls: everything is outside of it, hence lit.
    #[must_use]
    pub fn empty(light: DVec4) -> Self {
        let mut view = <Self as bytemuck::Zeroable>::zeroed();
        view.light = light.as_vec4().to_array();
        view
    }
}
