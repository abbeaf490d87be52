//! Layouts for lights that shine all around: how the sphere of directions is cut into views.

use antumbra_gpu::{Frame, GpuError, check_light};
use antumbra_scene::Light;
use antumbra_shaders::module;
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};
use serde::{Deserialize, Serialize};

use crate::fit::{NEAREST_SHARE, fit_perspective};
use crate::{Arrange, Drawing, FittedView, Fitting, Layout, SeenView, Sight, fit_seen};

/// How the directions around a point, sphere, rectangle or disc light are laid out in a map. Directional and spot
/// lights have one view whatever is chosen here.
///
/// Solid angles of texels are for a map without casters to fit to; perspective views shrink to the casters they
/// hold, charts do not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Omni {
    /// Six perspective views (default). The largest texel's solid angle is 5.2 times the smallest's.
    #[default]
    Cube,
    /// Four perspective views, the fewest (Liao 2010). Wide: the largest texel is 52 times the smallest, and
    /// a half of each layer lies outside its face.
    Tetrahedron,
    /// Six charts of equal area (Wan, Wong, Leung 2007): all texels the same. Drawn by tracing texels, so it
    /// needs the casters' triangles, and costs a large triangle's area in each view, twice over.
    Isocube,
    /// Two paraboloids (Brabec, Annen, Seidel 2002): the largest texel is 4 times the smallest. Drawn by tracing
    /// texels, as the isocube.
    DualParaboloid,
    /// The same with vertices moved to their places and edges left straight, as published: cheap, and wrong for
    /// edges that are long as seen from the light, which are drawn off by up to an eighth of their angle's
    /// square, in radians, of the map's half width.
    WarpedParaboloid,
}

impl Omni {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Cube,
        Self::Tetrahedron,
        Self::Isocube,
        Self::DualParaboloid,
        Self::WarpedParaboloid,
    ];

    /// Half the width of the paraboloid's or the isocube's chart in a map of `size` texels with a guard band of
    /// `guard`: 1 and the band. Charts do not go on for ever: on maps so small that the band would be more than
    /// two fifths, kernels repeat the border's texels instead.
    #[must_use]
    pub fn half_width(size: u32, guard: u32) -> f64 {
        let size = f64::from(size);
        (size / (size - 2.0 * f64::from(guard)).max(1.0)).min(1.4)
    }
}

impl Arrange for Omni {
    fn layout(&self, light: &Light) -> Layout {
        if matches!(light, Light::Directional { .. } | Light::Spot { .. }) {
            return Layout::single();
        }
        let curved = |select, chart, views, drawing| Layout {
            slots: vec![
                module("layout", select),
                module("common::projection", "map::curved"),
                module("chart", chart),
            ],
            views,
            drawing,
        };
        let paraboloid = |drawing| curved("map::layout_paraboloid", "map::paraboloid", 2, drawing);
        match self {
            Self::Cube => Layout::cube(),
            Self::Tetrahedron => Layout::of_matrices("map::layout_tetrahedron", 4),
            Self::Isocube => curved("map::layout_isocube", "map::isocube", 6, Drawing::Traced),
            Self::DualParaboloid => paraboloid(Drawing::Traced),
            Self::WarpedParaboloid => paraboloid(Drawing::Warped),
        }
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        let light = frame.light;
        let single = matches!(light, Light::Directional { .. } | Light::Spot { .. });
        let Some(center) = light.position().filter(|_| !single && *self != Self::Cube) else {
            return fit_seen(light, hull, sight, fitting);
        };
        check_light(light)?;
        let eye = center - fitting.origin;
        // Relative to the light.
        let rays: Vec<DVec3> = hull.iter().map(|p| *p - center).collect();
        let half_width = Self::half_width(fitting.size, fitting.guard);
        let view = |clip| SeenView::whole(FittedView { clip, light: eye.extend(1.0) });
        Ok(match self {
            Self::Cube => unreachable!("served by `fit`"),
            Self::Tetrahedron => {
                let face = |k| {
                    let (basis, tan_limit) = tetrahedron_face(k);
                    fit_perspective(light, (eye, basis, tan_limit), hull, sight, fitting)
                };
                (0..4).map(face).collect()
            }
            Self::Isocube => {
                let chart = |axis: DVec3| {
                    let polar = axis.y != 0.0;
                    let up = if polar { DVec3::Z } else { DVec3::Y };
                    let basis = chart_basis(axis, up);
                    let seen = in_reach(&rays, basis, isocube_reach(polar, half_width));
                    view(seen.then(|| chart_view(eye, basis, &rays, half_width, polar, fitting)))
                };
                [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z].map(chart).to_vec()
            }
            Self::DualParaboloid | Self::WarpedParaboloid => {
                let chart = |axis: DVec3| {
                    let basis = chart_basis(axis, DVec3::Z);
                    // The disc with its guard band reaches past the rim to 2 atan(half width) from the axis; what
                    // lies beyond is a convex cone: the hull is in it when its points are.
                    let h2 = half_width * half_width;
                    let rim = (1.0 - h2) / (1.0 + h2);
                    let seen = rays.iter().any(|v| axis.dot(*v) >= rim * v.length());
                    view(seen.then(|| chart_view(eye, basis, &rays, half_width, false, fitting)))
                };
                [DVec3::Y, -DVec3::Y].map(chart).to_vec()
            }
        })
    }
}

/// Face `k` of the tetrahedron: rows right, up, back of a view along the bisector of one corner and the middle of
/// the opposite edge, and the tangents of half the view's width and height: 143.99 and 125.26 degrees (Liao 2010).
#[must_use]
pub(crate) fn tetrahedron_face(k: usize) -> (DMat3, DVec2) {
    let corners = tetrahedron_corners(k);
    let back = -(corners[0] + (corners[1] + corners[2]).normalize()).normalize();
    let up = corners[0].reject_from_normalized(back).normalize();
    let basis = DMat3::from_cols(up.cross(back), up, back).transpose();
    let tangents = corners.map(|c| basis * c).map(|c| (c.truncate() / c.z).abs());
    (basis, tangents[0].max(tangents[1]).max(tangents[2]))
}

/// Directions of the corners of face `k`. Faces are named by their middles; the corners of one are opposite the
/// middles of the others.
pub(crate) fn tetrahedron_corners(k: usize) -> [DVec3; 3] {
    const MIDDLES: [DVec3; 4] = [
        DVec3::new(1.0, 1.0, 1.0),
        DVec3::new(-1.0, -1.0, 1.0),
        DVec3::new(-1.0, 1.0, -1.0),
        DVec3::new(1.0, -1.0, -1.0),
    ];
    [1, 2, 3].map(|i| -MIDDLES[(k + i) % 4].normalize())
}

/// Rows of the frame of a chart whose middle is `axis`, the third row.
fn chart_basis(axis: DVec3, up: DVec3) -> DMat3 {
    DMat3::from_cols(up.cross(axis), up, axis).transpose()
}

/// Tangents of the half angles of a pyramid around an isocube's chart of half width `half_width` (at most 1.4).
fn isocube_reach(polar: bool, half_width: f64) -> DVec2 {
    if polar {
        let height = 1.0 - half_width * half_width / 3.0;
        return DVec2::splat((1.0 - height * height).sqrt() / height);
    }
    let (longitude, height) = (half_width * std::f64::consts::FRAC_PI_4, half_width / 1.5);
    let forward = (1.0 - height * height).sqrt() * longitude.cos();
    DVec2::new(longitude.tan(), height / forward)
}

/// Whether some of the hull of `rays` may lie in the pyramid of half-angle tangents `reach` around the third row of
/// `basis`: no if all lie beyond one of its sides, or behind.
fn in_reach(rays: &[DVec3], basis: DMat3, reach: DVec2) -> bool {
    let local = || rays.iter().map(|v| basis * *v);
    let sides: [fn(DVec3, DVec2) -> f64; 5] = [
        |v, t| t.x * v.z - v.x,
        |v, t| t.x * v.z + v.x,
        |v, t| t.y * v.z - v.y,
        |v, t| t.y * v.z + v.y,
        |v, _| v.z,
    ];
    !rays.is_empty() && sides.iter().all(|side| local().any(|v| side(v, reach) >= 0.0))
}

/// The matrix of a view of `map::curved`: turns points relative to the origin into the chart's frame; the last row
/// holds its numbers.
///
/// Depth is near / distance, clamped to 1, so near may be any small distance: a float keeps it to a relative 2^-24.
fn chart_view(
    eye: DVec3,
    basis: DMat3,
    rays: &[DVec3],
    half_width: f64,
    polar: bool,
    fitting: &Fitting,
) -> DMat4 {
    let farthest = rays.iter().map(|v| v.length()).fold(0.0, f64::max);
    let near = (farthest * NEAREST_SHARE).max(f64::from(f32::MIN_POSITIVE));
    let polar = if polar { 1.0 } else { 0.0 };
    let column = |c: DVec3, last: f64| DVec4::new(c.x, c.y, c.z, last);
    DMat4::from_cols(
        column(basis.x_axis, half_width),
        column(basis.y_axis, polar),
        column(basis.z_axis, fitting.size.into()),
        column(basis * -eye, near),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tetrahedrons_views_have_the_published_angles() {
        for k in 0..4 {
            let (basis, tangents) = tetrahedron_face(k);
            assert!((basis * basis.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14), "a rotation");
            assert!((basis.determinant() - 1.0).abs() < 1e-14, "right-handed");
            let angle = |t: f64| 2.0 * t.atan().to_degrees();
            // arccos(1/3) + arctan(sqrt 2), and what follows for the width.
            assert!((angle(tangents.y) - 125.264_389_682_754_65).abs() < 1e-9, "height");
            assert!((angle(tangents.x) - 143.985_65).abs() < 1e-4, "width {}", angle(tangents.x));
        }
    }
}
