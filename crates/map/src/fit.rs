//! Light cameras, fitted in f64 to the casters that matter.
//!
//! Only casters need to be in the map: a receiver outside its window is lit, and a receiver beyond its far
//! end is compared with the far end. So the window is the casters' extent seen from the light, cut to the
//! light's cone or cube face, plus a guard band for the filter kernel. Where it is known what the camera sees,
//! only those casters count that can shadow it, and the window is no wider than what is seen.
//!
//! A window that follows the camera moves in whole texels of a size in coarse steps, so that shadow edges stand
//! still while the camera moves (Valient, "Stable Rendering of Cascaded Shadow Maps", 2008).

use antumbra_gpu::{GpuError, check_light};
use antumbra_scene::{Bounds, Light};
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

use crate::VisibleRegion;
use crate::visible::within;

/// What a fit needs to know about the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitting {
    /// World position of the zero of all `f32` positions, metres.
    pub origin: DVec3,
    /// Side of a layer, texels, >= 1.
    pub size: u32,
    /// Width of the band around the casters that stays free of them, texels: the kernel's radius and one
    /// more. On a map too small for it the band shrinks to what leaves one texel.
    pub guard: u32,
    /// Whether what only receives shadows is drawn too. An orthographic view's depth then goes on behind the
    /// farthest caster, as far as [`crate::LinearDepth`] does.
    pub receivers: bool,
}

/// A fitted view of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedView {
    /// Points relative to the origin to clip space, reversed depth; `None` where no caster falls into the
    /// view.
    pub clip: Option<DMat4>,
    /// xyz position relative to the origin and w = 1, or the unit direction towards the light and w = 0.
    pub light: DVec4,
}

/// A caster nearer to a positional light than this share of the farthest caster's distance is cut off when
/// the light stands amid the casters. Reversed float depth keeps its relative precision whatever the near
/// plane, so the share only has to be far below any distance that matters: 2^-14 is 6 mm at 100 m.
pub(crate) const NEAREST_SHARE: f64 = 1.0 / 16384.0;

/// What the camera sees, and what may shadow it.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// Where receivers are visible.
    pub region: &'a VisibleRegion,
    /// Boxes that together hold all casters, world space; the smaller, the less is drawn.
    pub casters: &'a [Bounds],
}

/// A view fitted to what can shadow something visible.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenView {
    /// The view.
    pub view: FittedView,
    /// Half-spaces (xyz inward unit normal, w offset; points relative to the origin) outside of any of which a
    /// caster has no say in this view; none where every caster has.
    pub volume: Vec<DVec4>,
    /// Two points (relative to the origin) between which, along the view's axis, lies every caster that has a say, and
    /// every visible receiver where these are drawn; `None` where every caster has. They move in steps, as the window
    /// does.
    pub ends: Option<[DVec3; 2]>,
}

impl SeenView {
    fn new(light: DVec4, fit: Option<Fit>) -> Self {
        let clip = fit.as_ref().map(|fit| fit.clip);
        let (volume, ends) = fit.map(|fit| (fit.volume, fit.ends)).unwrap_or_default();
        Self { view: FittedView { clip, light }, volume, ends }
    }

    /// A view to which nothing was fitted: every caster has a say.
    pub(crate) fn whole(view: FittedView) -> Self {
        Self { view, volume: Vec::new(), ends: None }
    }
}

/// A light's view before it is fitted, with f64 positions relative to the origin.
struct Stand<'a> {
    light: &'a Light,
    /// Rows: right, up, towards the light.
    basis: DMat3,
    /// All casters.
    points: &'a [DVec3],
    sight: Option<&'a Sight<'a>>,
    fitting: &'a Fitting,
}

/// What a view has to serve; points and half-spaces are relative to the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Needed {
    /// Corners of a convex body around the visible receivers.
    pub receivers: Vec<DVec3>,
    /// Corners of the casters that can shadow them.
    pub casters: Vec<DVec3>,
    /// Half-spaces (xyz inward unit normal, w offset) that hold these casters.
    pub volume: Vec<DVec4>,
}

/// A matrix, and what holds all that it has to show: half-spaces, and ends along its axis.
struct Fit {
    clip: DMat4,
    volume: Vec<DVec4>,
    ends: Option<[DVec3; 2]>,
}

/// Steps of the texel's size per doubling, for windows that follow the camera: 9 % are lost at most.
const STEPS: f64 = 8.0;

/// Fits the views of [`crate::Layout::of`] `light` to all casters, whose convex hull is that of `hull` (world space).
///
/// # Errors
/// A light with non-finite numbers, a zero direction, or a cone that is not within (0, 90) degrees.
pub fn fit(light: &Light, hull: &[DVec3], fitting: &Fitting) -> Result<Vec<FittedView>, GpuError> {
    Ok(fit_seen(light, hull, None, fitting)?.into_iter().map(|seen| seen.view).collect())
}

/// As [`fit`], but to those casters only that can shadow something in `sight`. On neither axis is the window
/// wider than that of [`fit`].
///
/// # Errors
/// As [`fit`].
pub fn fit_seen(
    light: &Light,
    hull: &[DVec3],
    sight: Option<&Sight<'_>>,
    fitting: &Fitting,
) -> Result<Vec<SeenView>, GpuError> {
    check_light(light)?;
    let points: Vec<DVec3> = hull.iter().map(|p| *p - fitting.origin).collect();
    // On a map that the kernel fills, every caster counts.
    let sight = sight.filter(|_| fitting.usable() >= 1.0);
    let stand = |back| Stand { light, basis: basis(back), points: &points, sight, fitting };
    let place = |p: DVec3| (p - fitting.origin).extend(1.0);
    Ok(match *light {
        Light::Directional { direction, .. } => {
            let to_light = -direction.normalize();
            vec![SeenView::new(to_light.extend(0.0), stand(to_light).orthographic())]
        }
        Light::Spot { position, direction, outer_angle } => {
            let light = place(position);
            let stand = stand(-direction.normalize());
            let tan_limit = DVec2::splat(outer_angle.tan());
            vec![SeenView::new(light, stand.perspective(light.truncate(), tan_limit))]
        }
        Light::Point { position: center }
        | Light::Sphere { center, .. }
        | Light::Rect { center, .. }
        | Light::Disc { center, .. } => {
            let light = place(center);
            let face = |axis: DVec3| {
                SeenView::new(light, stand(-axis).perspective(light.truncate(), DVec2::ONE))
            };
            [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z].map(face).to_vec()
        }
    })
}

/// As [`fit_seen`], for one perspective view of a light at `eye` (relative to the origin), down -z of `basis`, whose
/// rows are right, up and back, at most `tan_limit` wide and high on either side.
#[must_use]
pub fn fit_perspective(
    light: &Light,
    (eye, basis, tan_limit): (DVec3, DMat3, DVec2),
    hull: &[DVec3],
    sight: Option<&Sight<'_>>,
    fitting: &Fitting,
) -> SeenView {
    let points: Vec<DVec3> = hull.iter().map(|p| *p - fitting.origin).collect();
    let sight = sight.filter(|_| fitting.usable() >= 1.0);
    let stand = Stand { light, basis, points: &points, sight, fitting };
    SeenView::new(eye.extend(1.0), stand.perspective(eye, tan_limit))
}

/// Rows of a right-handed light basis: right, up, and `back`, the unit vector towards the light.
#[must_use]
pub fn basis(back: DVec3) -> DMat3 {
    let a = back.abs();
    let up = if a.x <= a.y && a.x <= a.z {
        DVec3::X
    } else if a.y <= a.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let right = up.cross(back).normalize();
    DMat3::from_cols(right, back.cross(right), back).transpose()
}

/// The interval that `values` span.
fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// The part that two intervals share, if any.
fn shared(a: (f64, f64), b: (f64, f64)) -> Option<(f64, f64)> {
    let (lo, hi) = (a.0.max(b.0), a.1.min(b.1));
    (lo <= hi).then_some((lo, hi))
}

impl Fitting {
    /// Texels a side that are left for casters where the window moves in whole texels; less than 1 on a map that the
    /// kernel fills.
    #[must_use]
    pub fn usable(&self) -> f64 {
        f64::from(self.size) - 2.0 * f64::from(self.guard) - 1.0
    }

    /// Widens [lo, hi], which casters fill, by the guard band on both sides.
    fn with_guard(&self, (lo, hi): (f64, f64), least: f64) -> (f64, f64) {
        let (size, guard) = (f64::from(self.size), f64::from(self.guard));
        let half = (0.5 * (hi - lo)).max(least) * size / (size - 2.0 * guard).max(1.0);
        let middle = 0.5 * (lo + hi);
        (middle - half, middle + half)
    }

    /// Bound on the texel's size of a window around `extent` that matters.
    fn texel(&self, extent: f64) -> f64 {
        extent / self.usable() * (1.0 / STEPS).exp2()
    }

    /// The window around `all` casters, or a narrower one around those that matter.
    ///
    /// The narrower one has its borders on a grid that starts at the wide one's, and texels smaller than that one's
    /// by a power of two to a multiple of 1 / [`STEPS`]: it moves and grows in steps, and the same ones wherever the
    /// scene stands and whatever the unit of length.
    fn window(&self, all: (f64, f64), seen: Option<(f64, f64)>, least: f64) -> (f64, f64) {
        let all = self.with_guard(all, least);
        let Some((lo, hi)) = seen else {
            return all;
        };
        let size = f64::from(self.size);
        let widest = (all.1 - all.0) / size;
        let needed = (hi - lo).max(2.0 * least) / self.usable();
        let steps = ((widest / needed).log2() * STEPS).floor();
        if steps < 1.0 {
            return all;
        }
        let texel = widest * (-steps / STEPS).exp2();
        // [lo, hi] begins within the first texel after the guard band, and spans at most the usable ones.
        let left = all.0 + (((lo - all.0) / texel).floor() - f64::from(self.guard)) * texel;
        (left, left + size * texel)
    }
}

impl Sight<'_> {
    /// What matters for receivers within the half-spaces `cone` (points relative to the origin); `None` where there is
    /// no receiver or no caster that can shadow one. `texel` bounds the size of a texel, in metres, anywhere among
    /// the receivers with the given corners.
    pub fn needed(
        &self,
        light: &Light,
        cone: &[DVec4],
        texel: impl Fn(&[DVec3]) -> f64,
        fitting: &Fitting,
    ) -> Option<Needed> {
        let reach = self.region.reach(light, cone, fitting.origin)?;
        // A kernel reads texels beside the sample's own: up to the guard band's width away an axis.
        let margin = std::f64::consts::SQRT_2 * f64::from(fitting.guard) * texel(&reach.receivers);
        let volume: Vec<DVec4> = reach.volume.iter().map(|p| *p + DVec4::W * margin).collect();
        let casters = within(self.casters, &volume, fitting.origin);
        (!casters.is_empty()).then_some(Needed { receivers: reach.receivers, casters, volume })
    }
}

impl Stand<'_> {
    fn orthographic(&self) -> Option<Fit> {
        let (basis, points, fitting) = (&self.basis, self.points, self.fitting);
        if points.is_empty() {
            return None;
        }
        let axis = |points: &[DVec3], i: usize| span(points.iter().map(|p| basis.row(i).dot(*p)));
        let all = [0, 1, 2].map(|i| axis(points, i));
        let extent = all.iter().map(|a| a.1 - a.0).fold(0.0, f64::max);
        let farthest = points.iter().map(|p| p.length()).fold(0.0, f64::max);
        // A flat or distant set still needs a window and a depth range that f32 resolves: 2^-20 of the
        // coordinates is 16 of their steps.
        let least = (extent.max(farthest) * 2f64.powi(-20)).max(f64::from(f32::MIN_POSITIVE));
        // The nearest caster must not be clipped nor the farthest be mistaken for an empty texel, so the range
        // reaches beyond both by more than the rounding of a transformed vertex.
        let pad = (all[2].1 - all[2].0) * 2f64.powi(-12) + least;
        let (mut far, mut near) = (all[2].0 - pad, all[2].1 + pad);
        let (mut seen, mut volume, mut ends) = ([None; 2], Vec::new(), None);
        // Where the last receiver that matters lies, if that is known.
        let mut last = None;
        if let Some(sight) = self.sight {
            let widest = |points: &[DVec3]| {
                let extents = [0, 1].map(|i| axis(points, i)).map(|a| a.1 - a.0);
                fitting.texel(extents[0].max(extents[1]).max(2.0 * least))
            };
            let needed = sight.needed(self.light, &[], widest, fitting)?;
            for (i, seen) in seen.iter_mut().enumerate() {
                *seen = Some(shared(axis(&needed.casters, i), axis(&needed.receivers, i))?);
            }
            let (lo, hi) = axis(&needed.casters, 2);
            // In eighths of the range, rounded to a power of two, which cost the map no resolution.
            let (end, range) = (far, near - far);
            let step = range * ((hi - lo + 2.0 * pad) / range).log2().floor().exp2() / 8.0;
            far = far.max(end + ((lo - pad - end) / step).floor() * step);
            near = near.min(end + ((hi + pad - end) / step).ceil() * step);
            volume = needed.volume;
            let (lo, _) = axis(&needed.receivers, 2);
            last = Some(end + ((lo - pad - end) / step).floor() * step);
            ends = Some([near, far]);
        }
        let (left, right) = fitting.window(all[0], seen[0], least);
        let (bottom, top) = fitting.window(all[1], seen[1], least);
        if fitting.receivers {
            let beyond = far - (near - far).max(right - left);
            far = last.map_or(beyond, |last| last.max(beyond).min(far));
            ends = ends.map(|[near, _]| [near, far]);
        }
        let ends = ends.map(|ends| ends.map(|z| basis.row(2) * z));
        let scale = DVec3::new(2.0 / (right - left), 2.0 / (top - bottom), 1.0 / (near - far));
        let shift = DVec3::new(
            -(right + left) / (right - left),
            -(top + bottom) / (top - bottom),
            -far / (near - far),
        );
        let linear = DMat3::from_diagonal(scale) * *basis;
        Some(Fit { clip: DMat4::from_mat3_translation(linear, shift), volume, ends })
    }

    /// A perspective view from `eye` down -z of the basis, at most `tan_limit` wide on either side, with infinite
    /// reversed depth: z = near / distance, which f32 keeps to a relative 2^-24 at every distance.
    fn perspective(&self, eye: DVec3, tan_limit: DVec2) -> Option<Fit> {
        let (basis, fitting) = (self.basis, self.fitting);
        let local = |points: &[DVec3]| -> Vec<DVec3> {
            points.iter().map(|p| basis * (*p - eye)).collect()
        };
        let all = Frontal::of(&local(self.points), tan_limit)?;
        let (mut near, mut seen) = (all.near, [None; 2]);
        let (mut volume, mut ends) = (Vec::new(), None);
        if let Some(sight) = self.sight {
            let widest = |receivers: &[DVec3]| {
                let widest = 2.0 * tan_limit.max_element();
                let receivers = local(receivers);
                let farthest = receivers.iter().map(|p| -p.z).fold(0.0, f64::max);
                let extent = Frontal::of(&receivers, tan_limit).map_or(widest, |receivers| {
                    receivers.window.map(|w| w.1 - w.0).into_iter().fold(0.0, f64::max)
                });
                farthest * fitting.texel(extent.max(widest * LEAST_SHARE))
            };
            let cone = cone(eye, &basis, tan_limit);
            let needed = sight.needed(self.light, &cone, widest, fitting)?;
            let (receivers, casters) = (local(&needed.receivers), local(&needed.casters));
            let receivers = Frontal::of(&receivers, tan_limit)?;
            let matter = Frontal::of(&casters, tan_limit)?;
            for (i, seen) in seen.iter_mut().enumerate() {
                *seen = Some(shared(matter.window[i], receivers.window[i])?);
            }
            near *= (matter.near / near).log2().floor().exp2();
            let step = |distance: f64| {
                let steps = (all.farthest / distance).log2() * STEPS;
                all.farthest * (-steps.floor() / STEPS).exp2()
            };
            let mut far = step(matter.farthest);
            if fitting.receivers {
                // As far again, or as wide as the view is there.
                let beyond = far + (far - near).max(2.0 * far * tan_limit.max_element());
                far = step(receivers.farthest).clamp(far, beyond);
            }
            volume = needed.volume;
            ends = Some([near, far].map(|distance| eye - basis.row(2) * distance));
        }
        let window = |i: usize| {
            let widest = (-tan_limit[i], tan_limit[i]);
            let whole = shared(all.window[i], widest)?;
            let seen = match seen[i] {
                Some(seen) => Some(shared(seen, widest)?),
                None => None,
            };
            Some(fitting.window(whole, seen, tan_limit[i] * LEAST_SHARE))
        };
        let ((left, right), (bottom, top)) = (window(0)?, window(1)?);
        let projection = DMat4::from_cols(
            DVec4::new(2.0 / (right - left), 0.0, 0.0, 0.0),
            DVec4::new(0.0, 2.0 / (top - bottom), 0.0, 0.0),
            DVec4::new((right + left) / (right - left), (top + bottom) / (top - bottom), 0.0, -1.0),
            DVec4::new(0.0, 0.0, near, 0.0),
        );
        let clip = projection * DMat4::from_mat3_translation(basis, basis * -eye);
        Some(Fit { clip, volume, ends })
    }
}

/// The least half window of a perspective view, as a share of its widest.
const LEAST_SHARE: f64 = 1.0 / 1048576.0;

/// Points seen down -z, of which some lie in front.
struct Frontal {
    /// Their extent in x / -z and y / -z; the widest where some of them lie behind or almost.
    window: [(f64, f64); 2],
    /// Distance of a near plane that cuts off none of them, or next to nothing.
    near: f64,
    /// The largest distance along the axis.
    farthest: f64,
}

impl Frontal {
    fn of(points: &[DVec3], tan_limit: DVec2) -> Option<Self> {
        let (nearest, farthest) = span(points.iter().map(|p| -p.z));
        if points.is_empty() || farthest <= 0.0 {
            return None;
        }
        let near = (nearest * (1.0 - 2f64.powi(-8))).max(farthest * NEAREST_SHARE);
        // With every point in front of the eye the hull's projection is the projections' hull.
        let window = [0, 1].map(|i| {
            if nearest >= near {
                span(points.iter().map(|p| p[i] / -p.z))
            } else {
                (-tan_limit[i], tan_limit[i])
            }
        });
        Some(Self { window, near, farthest })
    }
}

/// The half-spaces of the view from `eye` down -z of `basis`.
fn cone(eye: DVec3, basis: &DMat3, tan_limit: DVec2) -> [DVec4; 4] {
    let (a, b, front) = (basis.row(0), basis.row(1), -basis.row(2));
    let (x, y) = (tan_limit.x, tan_limit.y);
    [(a, x), (-a, x), (b, y), (-b, y)].map(|(aside, tan_limit)| {
        let normal = (front * tan_limit + aside).normalize();
        normal.extend(-normal.dot(eye))
    })
}

#[cfg(test)]
mod tests {
    use antumbra_gpu::ViewCamera;

    use super::*;

    const FITTING: Fitting = Fitting { origin: DVec3::ZERO, size: 256, guard: 2, receivers: false };

    fn cube_corners(center: DVec3, half: f64) -> Vec<DVec3> {
        (0..8)
            .map(|i| {
                let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
                center + half * DVec3::new(sign(0), sign(1), sign(2))
            })
            .collect()
    }

    fn lights() -> Vec<Light> {
        vec![
            Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
            Light::Directional { direction: DVec3::new(0.3, -1.0, 0.2), angular_diameter: 0.0 },
            Light::Spot { position: DVec3::Y * 9.0, direction: DVec3::NEG_Y, outer_angle: 0.7 },
            Light::Point { position: DVec3::new(0.1, 0.2, 0.3) },
            Light::Point { position: DVec3::new(0.0, 7.0, 1.0) },
        ]
    }

    #[test]
    fn every_caster_in_reach_lands_inside_the_guard_band() {
        let points = cube_corners(DVec3::ZERO, 1.0);
        let inner = 1.0 - 2.0 * f64::from(FITTING.guard) / f64::from(FITTING.size) + 1e-12;
        for light in lights() {
            let views = fit(&light, &points, &FITTING).expect("the light is valid");
            for p in &points {
                let seen = views.iter().filter_map(|v| v.clip).any(|clip| {
                    let c = clip * p.extend(1.0);
                    c.w > 0.0
                        && c.x.abs() <= c.w * inner
                        && c.y.abs() <= c.w * inner
                        && c.z > 0.0
                        && c.z < c.w
                });
                assert!(seen, "{light:?} misses the caster corner {p}");
            }
        }
    }

    #[test]
    fn depth_decreases_away_from_the_light() {
        for light in lights() {
            let views =
                fit(&light, &cube_corners(DVec3::ZERO, 1.0), &FITTING).expect("valid light");
            let view = views.iter().find(|v| v.clip.is_some()).expect("a view with casters");
            let clip = view.clip.expect("a view with casters");
            let away = match light {
                Light::Directional { direction, .. } => direction,
                _ => -clip.row(3).truncate() * -1.0,
            };
            let depth = |p: DVec3| clip.project_point3(p).z;
            let p = view.light.truncate() * view.light.w + away.normalize() * 5.0;
            assert!(depth(p) > depth(p + away), "{light:?} has no reversed depth");
        }
    }

    #[test]
    fn a_light_without_casters_needs_no_view() {
        for light in lights() {
            let views = fit(&light, &[], &FITTING).expect("the light is valid");
            assert!(views.iter().all(|v| v.clip.is_none()), "{light:?} has a view of nothing");
        }
    }

    #[test]
    fn casters_outside_the_cone_or_behind_the_light_need_no_view() {
        let spot = Light::Spot { position: DVec3::ZERO, direction: DVec3::NEG_Y, outer_angle: 0.3 };
        for center in [DVec3::new(9.0, -3.0, 0.0), DVec3::Y * 5.0] {
            let views = fit(&spot, &cube_corners(center, 1.0), &FITTING).expect("valid light");
            assert_eq!(views[0].clip, None, "casters at {center} cannot be seen");
        }
    }

    #[test]
    fn bad_lights_are_refused_with_a_reason() {
        let bad = [
            Light::Directional { direction: DVec3::ZERO, angular_diameter: 0.0 },
            Light::Directional { direction: DVec3::NAN, angular_diameter: 0.0 },
            Light::Point { position: DVec3::INFINITY },
            Light::Spot { position: DVec3::ZERO, direction: DVec3::X, outer_angle: 1.6 },
            Light::Spot { position: DVec3::ZERO, direction: DVec3::X, outer_angle: 0.0 },
        ];
        for light in bad {
            let refused = fit(&light, &cube_corners(DVec3::ZERO, 1.0), &FITTING);
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{light:?} passed");
        }
    }

    #[test]
    fn degenerate_casters_still_give_finite_views() {
        for light in lights() {
            for points in [vec![DVec3::ZERO], vec![DVec3::ZERO, DVec3::X], vec![DVec3::splat(1e6)]]
            {
                for size in [1, 2, 8192] {
                    let fitting = Fitting { size, ..FITTING };
                    for view in fit(&light, &points, &fitting).expect("valid light") {
                        let finite = view.clip.is_none_or(|c| c.as_mat4().is_finite());
                        assert!(finite, "{light:?} over {points:?}: {view:?}");
                    }
                }
            }
        }
    }

    /// Houses of a town of 20 x 20, world space.
    fn town() -> Vec<Bounds> {
        let house = |x: i32, z: i32| {
            let min = DVec3::new(f64::from(x) * 10.0, 0.0, f64::from(z) * 10.0);
            Bounds { min, max: min + DVec3::new(6.0, f64::from(1 + (x * 7 + z * 3) % 5), 6.0) }
        };
        (0..20).flat_map(|x| (0..20).map(move |z| house(x, z))).collect()
    }

    fn corners(boxes: &[Bounds]) -> Vec<DVec3> {
        boxes.iter().flat_map(Bounds::corners).collect()
    }

    fn region(eye: DVec3, forward: DVec3, receivers: &[Bounds]) -> VisibleRegion {
        let camera = antumbra_scene::Camera {
            eye,
            target: eye + forward,
            up: DVec3::Y,
            fov_y: 0.9,
            near: 0.1,
        };
        let clip = camera.view_projection(DVec3::ZERO, 1.3);
        VisibleRegion::new(&ViewCamera { clip, eye }, receivers, DVec3::ZERO).expect("a camera")
    }

    /// Half of the texels' number over metres (of the light's plane, or at distance 1), on both axes.
    fn scales(clip: &DMat4) -> [f64; 2] {
        let w = clip.row(3).truncate();
        [0, 1].map(|i| {
            let row = clip.row(i).truncate();
            (row - w * row.dot(w) / w.length_squared().max(1e-300)).length()
        })
    }

    fn town_lights() -> Vec<Light> {
        let lamp = DVec3::new(98.0, 7.0, 103.0);
        vec![
            Light::sun(0.8, 0.6, 0.0),
            Light::sun(1.5, 0.1, 0.01),
            Light::Spot {
                position: lamp,
                direction: DVec3::new(0.5, -1.0, -0.6).normalize(),
                outer_angle: 0.7,
            },
            Light::Point { position: lamp },
            Light::Sphere { center: lamp, radius: 0.5 },
        ]
    }

    /// Corners of casters in a view's half-spaces lie between its ends, or before its near plane.
    fn ends_hold_what_is_in_the_volume(seen: &[SeenView], casters: &[Bounds]) {
        for SeenView { view, volume, ends } in seen {
            let (Some(clip), Some([near, far])) = (&view.clip, ends) else { continue };
            // Depth grows towards the light for both projections.
            let depth = |p: DVec3| {
                let c = clip * p.extend(1.0);
                if c.w > 0.0 { c.z / c.w } else { f64::INFINITY }
            };
            for corner in corners(casters) {
                if volume.iter().all(|plane| crate::visible::side(plane, corner) >= 0.0) {
                    let found = depth(corner);
                    let (first, last) = (depth(*near), depth(*far));
                    assert!(found >= last * (1.0 - 1e-9), "{corner} beyond the far end");
                    assert!(
                        found <= first * (1.0 + 1e-9) || found > 1.0,
                        "{corner} before the near end"
                    );
                }
            }
        }
    }

    #[test]
    fn a_fit_to_what_is_seen_is_no_wider_and_holds_every_caster_that_matters() {
        let town = town();
        let (mut receivers, hull) = (town.clone(), corners(&town));
        receivers
            .push(Bounds { min: DVec3::new(0.0, 0.0, 0.0), max: DVec3::new(200.0, 0.0, 200.0) });
        let fitting = Fitting { size: 1024, ..FITTING };
        let mut narrower = 0;
        for turn in 0..24 {
            let angle = f64::from(turn) * 0.7;
            let eye = DVec3::new(97.0 + f64::from(turn), 1.7, 98.0);
            let forward = DVec3::new(angle.cos(), -0.2, angle.sin());
            let region = region(eye, forward, &receivers);
            for light in town_lights() {
                let all = fit(&light, &hull, &fitting).expect("valid");
                let sight = Sight { region: &region, casters: &town };
                let seen = fit_seen(&light, &hull, Some(&sight), &fitting).expect("valid");
                for (all, seen) in all.iter().zip(&seen) {
                    let Some(clip) = seen.view.clip else { continue };
                    let all = scales(&all.clip.expect("more casters than are seen"));
                    let scales = scales(&clip);
                    assert!(
                        (0..2).all(|i| scales[i] >= all[i] * (1.0 - 1e-12)),
                        "{light:?}: wider"
                    );
                    narrower += usize::from(scales[0] * scales[1] > 4.0 * all[0] * all[1]);
                }
                ends_hold_what_is_in_the_volume(&seen, &town);
                // A point of a caster between a corner of the region and the light, in the view that looks there.
                let receivers: Vec<DVec3> = region.corners().collect();
                for (i, p) in receivers.iter().enumerate() {
                    let towards = light.towards(*p, DVec2::splat(0.5));
                    let reach = if light.position().is_some() { 1.0 } else { 60.0 };
                    for step in 0..50 {
                        let q = *p + towards * (reach * (f64::from(step) + 0.5) / 50.0);
                        let within = |b: &Bounds| q.cmpge(b.min).all() && q.cmple(b.max).all();
                        if !town.iter().any(within) {
                            continue;
                        }
                        let shown = seen.iter().filter_map(|v| v.view.clip).any(|clip| {
                            let c = clip * q.extend(1.0);
                            c.w > 0.0
                                && c.x.abs() <= c.w
                                && c.y.abs() <= c.w
                                && c.z > 0.0
                                && c.z <= c.w
                        });
                        let near = light.position().is_some_and(|l| l.distance(q) < 0.1);
                        let cone = match light {
                            Light::Spot { position, direction, outer_angle } => {
                                (q - position).angle_between(direction) < outer_angle
                            }
                            _ => true,
                        };
                        assert!(
                            shown || near || !cone,
                            "{light:?}: {q} before corner {i} is cut off"
                        );
                    }
                }
            }
        }
        assert!(narrower > 40, "only {narrower} windows are less than half as wide");
    }

    #[test]
    fn a_window_that_follows_the_camera_moves_in_whole_texels() {
        let town = town();
        let hull = corners(&town);
        let fitting = Fitting { size: 1024, ..FITTING };
        let p = DVec3::new(100.0, 0.5, 95.0);
        for light in [town_lights()[0], town_lights()[2]] {
            let mut before: Option<DMat4> = None;
            let (mut moves, mut stays) = (0, 0);
            for frame in 0..400 {
                let eye = DVec3::new(97.0 + 0.003 * f64::from(frame), 1.7, 98.0);
                let region = region(eye, DVec3::new(0.2, -0.3, -1.0), &town);
                let sight = Sight { region: &region, casters: &town };
                let seen = fit_seen(&light, &hull, Some(&sight), &fitting).expect("valid");
                let clip = seen[0].view.clip.expect("houses in view");
                if let Some(before) = before {
                    let change = clip.project_point3(p) - before.project_point3(p);
                    let texels = change.truncate() * 0.5 * f64::from(fitting.size);
                    let (was, is) = (scales(&before), scales(&clip));
                    for i in 0..2 {
                        if (was[i] - is[i]).abs() > 1e-9 * is[i] {
                            continue;
                        }
                        assert!(
                            (texels[i] - texels[i].round()).abs() < 1e-6,
                            "{light:?}: {texels}"
                        );
                        moves += usize::from(texels[i].abs() > 0.5);
                        stays += usize::from(texels[i].abs() < 0.5);
                    }
                }
                before = Some(clip);
            }
            assert!(moves > 0 && stays > moves, "{light:?}: {moves} moves, {stays} frames without");
        }
    }
}
