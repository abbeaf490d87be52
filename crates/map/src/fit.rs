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
    /// Texels, >= 1, in multiples of which windows that follow the camera move: as many as a texel of a store stands for.
    pub grid: u32,
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
    /// Points (relative to the origin) along the view's axis: every caster that has a say lies between the first and the
    /// second, and every visible receiver before the third where these are drawn, else it is the second again; `None`
    /// where every caster has. They move in steps, as the window does.
    pub ends: Option<[DVec3; 3]>,
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
    /// Half-spaces (points relative to the origin) around the receivers of a light with an extent, of which every point
    /// counts; without them only the light's centre does.
    served: Option<&'a [DVec4]>,
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
    /// By how much they are moved out for the kernel's reach, metres.
    pub margin: f64,
}

/// A matrix, and what holds all that it has to show: half-spaces, and ends along its axis.
struct Fit {
    clip: DMat4,
    volume: Vec<DVec4>,
    ends: Option<[DVec3; 3]>,
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
    let served = None;
    let stand = |back| Stand { light, basis: basis(back), points: &points, sight, served, fitting };
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
    fit_from(light, (eye, basis, tan_limit), None, hull, sight, fitting)
}

/// As [`fit_perspective`], for a light with an extent: casters count that hide any point of it from visible receivers within
/// the half-spaces `served` (points relative to the origin), wherever the light's centre sees these. So the window is that
/// of the casters between light and receivers, as wide as the light at the light and no wider than the receivers at these.
#[must_use]
pub fn fit_wide(
    light: &Light,
    (eye, basis, tan_limit): (DVec3, DMat3, DVec2),
    served: &[DVec4],
    hull: &[DVec3],
    sight: Option<&Sight<'_>>,
    fitting: &Fitting,
) -> SeenView {
    fit_from(light, (eye, basis, tan_limit), Some(served), hull, sight, fitting)
}

/// A perspective view, for the light's centre or for all of it.
fn fit_from(
    light: &Light,
    (eye, basis, tan_limit): (DVec3, DMat3, DVec2),
    served: Option<&[DVec4]>,
    hull: &[DVec3],
    sight: Option<&Sight<'_>>,
    fitting: &Fitting,
) -> SeenView {
    let points: Vec<DVec3> = hull.iter().map(|p| *p - fitting.origin).collect();
    let sight = sight.filter(|_| fitting.usable() >= 1.0);
    let stand = Stand { light, basis, points: &points, sight, served, fitting };
    SeenView::new(eye.extend(1.0), stand.perspective(eye, tan_limit))
}

/// As [`fit_wide`], for a directional light along `direction` (a unit vector), of whose angle every direction counts.
#[must_use]
pub fn fit_wide_sun(
    light: &Light,
    direction: DVec3,
    hull: &[DVec3],
    sight: Option<&Sight<'_>>,
    fitting: &Fitting,
) -> SeenView {
    let points: Vec<DVec3> = hull.iter().map(|p| *p - fitting.origin).collect();
    let sight = sight.filter(|_| fitting.usable() >= 1.0);
    let (basis, served) = (basis(-direction), Some(&[][..]));
    let stand = Stand { light, basis, points: &points, sight, served, fitting };
    SeenView::new((-direction).extend(0.0), stand.orthographic())
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
    /// Texels a side that are left for casters where the window moves in whole texels, or multiples of them; less than 1
    /// on a map that the kernel fills.
    #[must_use]
    pub fn usable(&self) -> f64 {
        f64::from(self.size) - 2.0 * f64::from(self.guard) - f64::from(self.grid)
    }

    /// Where, in texels, a window with guard band begins, around what begins at `lo`: up to `grid` texels before.
    #[must_use]
    pub fn left(&self, lo: f64) -> f64 {
        let grid = f64::from(self.grid);
        ((lo - f64::from(self.guard)) / grid).floor() * grid
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
        // [lo, hi] begins within the first texels after the guard band, and spans at most the usable ones.
        let left = all.0 + self.left((lo - all.0) / texel) * texel;
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
        let receivers = reach.receivers;
        (!casters.is_empty()).then_some(Needed { receivers, casters, volume, margin })
    }
}

impl Stand<'_> {
    /// What of the window of casters that matter has to be in the map: what receivers look at on their way to the light's
    /// centre, or to all of it.
    fn window_of(
        &self,
        casters: (f64, f64),
        receivers: impl Fn() -> (f64, f64),
    ) -> Option<(f64, f64)> {
        if self.served.is_some() { Some(casters) } else { shared(casters, receivers()) }
    }

    /// The half-spaces by which what is drawn is culled: none where receivers are, if windows reach beyond what is seen, as
    /// they do towards a light with an extent.
    fn culled_by(&self, volume: Vec<DVec4>) -> Vec<DVec4> {
        if self.served.is_some() && self.fitting.receivers { Vec::new() } else { volume }
    }

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
                let receivers = || axis(&needed.receivers, i);
                *seen = Some(self.window_of(axis(&needed.casters, i), receivers)?);
            }
            let (lo, hi) = axis(&needed.casters, 2);
            // In eighths of the range, rounded to a power of two, which cost the map no resolution.
            let (end, range) = (far, near - far);
            let step = range * ((hi - lo + 2.0 * pad) / range).log2().floor().exp2() / 8.0;
            far = far.max(end + ((lo - pad - end) / step).floor() * step);
            near = near.min(end + ((hi + pad - end) / step).ceil() * step);
            volume = self.culled_by(needed.volume);
            let (lo, _) = axis(&needed.receivers, 2);
            last = Some(end + ((lo - pad - end) / step).floor() * step);
            ends = Some([near, far, far]);
        }
        let (left, right) = fitting.window(all[0], seen[0], least);
        let (bottom, top) = fitting.window(all[1], seen[1], least);
        if fitting.receivers {
            let beyond = far - (near - far).max(right - left);
            far = last.map_or(beyond, |last| last.max(beyond).min(far));
            ends = ends.map(|[near, casters, _]| [near, casters, far]);
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
            let served = self.served.unwrap_or(&cone);
            let needed = sight.needed(self.light, served, widest, fitting)?;
            let (receivers, casters) = (local(&needed.receivers), local(&needed.casters));
            let receivers = Frontal::of(&receivers, tan_limit)?;
            let matter = Frontal::of(&casters, tan_limit)?;
            for (i, seen) in seen.iter_mut().enumerate() {
                *seen = Some(self.window_of(matter.window[i], || receivers.window[i])?);
            }
            near *= (matter.near / near).log2().floor().exp2();
            let step = |distance: f64| {
                let steps = (all.farthest / distance).log2() * STEPS;
                all.farthest * (-steps.floor() / STEPS).exp2()
            };
            let casters = step(matter.farthest);
            let mut far = casters;
            if fitting.receivers {
                // As far again, or as wide as the view is there.
                let beyond = far + (far - near).max(2.0 * far * tan_limit.max_element());
                far = step(receivers.farthest).clamp(far, beyond);
            }
            let tilt = needed.margin / receivers.farthest;
            let widened = |plane: &DVec4| tilted(plane, needed.margin, tilt, (eye, -basis.row(2)));
            volume = self.culled_by(needed.volume.iter().map(widened).collect());
            ends = Some([near, casters, far].map(|distance| eye - basis.row(2) * distance));
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

/// A half-space that is moved out by `margin`, as a view from `eye` along `front` needs it whose kernels reach `tilt` aside
/// at a distance of 1: where it goes through `eye` it is turned out instead. What is beside a sample's own texel is beside it
/// at every distance, also beyond the farthest receiver, where a receiver's plane may go on.
fn tilted(plane: &DVec4, margin: f64, tilt: f64, (eye, front): (DVec3, DVec3)) -> DVec4 {
    let own = plane.truncate();
    let from_eye = own.dot(eye) + plane.w - margin;
    if from_eye.abs() > 1e-9 * (eye.length() + margin) {
        return *plane;
    }
    let turned = (own + tilt * front).normalize_or_zero();
    // Rounding, and corners that lie in the half-space's border.
    turned.extend(-turned.dot(eye) + margin / 64.0)
}

/// The half-spaces of the view from `eye` down -z of `basis`, of so wide half-angle tangents.
#[must_use]
pub fn cone(eye: DVec3, basis: &DMat3, tan_limit: DVec2) -> [DVec4; 4] {
    let (a, b, front) = (basis.row(0), basis.row(1), -basis.row(2));
    let (x, y) = (tan_limit.x, tan_limit.y);
    [(a, x), (-a, x), (b, y), (-b, y)].map(|(aside, tan_limit)| {
        let normal = (front * tan_limit + aside).normalize();
        normal.extend(-normal.dot(eye))
    })
}

#[cfg(test)]
mod tests;
