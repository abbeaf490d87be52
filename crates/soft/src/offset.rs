//! Views from behind a flat light, into slices parallel to it.

use antumbra_gpu::{Frame, GpuError, check_light};
use antumbra_map::{Arrange, Fitting, Layout, Omni, SeenView, Sight, fit_perspective};
use antumbra_scene::Light;
use glam::{DMat3, DVec2, DVec3};

use crate::Facing;
use crate::facing::{axes, half_sides};

/// Two views of a rectangle or a disc, of what lies before it and behind, each from a point off the other side. Others
/// have the views of [`Facing`].
///
/// The farther off that point is, the less what lies in a slice is moved to the side as it is flattened; but from
/// infinitely far off nothing in a slice would hide what is behind it from the light. So it lies as far off as the
/// pyramid through the light's outline still holds the casters (Eisemann, Décoret 2006).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Offset {
    /// Layout of point lights, and of lights of size 0.
    pub hard: Omni,
    /// Whether the point lies off the light, or in its centre.
    pub offset: bool,
}

/// Widest half aperture, as a tangent: what a flat light sees within 83 degrees of its axis.
const WIDEST: f64 = 8.0;

/// Farthest that a view stands off, in distances of the farthest caster.
const FARTHEST: f64 = 4.0;

impl Offset {
    fn is_flat(light: &Light) -> bool {
        !light.is_hard() && matches!(light, Light::Rect { .. } | Light::Disc { .. })
    }
}

impl Arrange for Offset {
    fn layout(&self, light: &Light) -> Layout {
        if Self::is_flat(light) {
            return Layout::of_matrices("soft::layout_sides", 2);
        }
        Facing { hard: self.hard }.layout(light)
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        let light = frame.light;
        let facing = Facing { hard: self.hard };
        let (true, Some(center)) = (Self::is_flat(light), light.position()) else {
            return facing.fit(frame, hull, sight, fitting);
        };
        check_light(light)?;
        // Its checks of the light's size, too.
        facing.fit(frame, &[], None, fitting)?;
        let [u, v, n] = axes(light);
        let side = |(axis, right): (DVec3, DVec3)| {
            let stand_off = if self.offset { stand_off(light, hull, center, axis) } else { 0.0 };
            let eye = center - axis * stand_off - fitting.origin;
            let basis = DMat3::from_cols(right, v, -axis).transpose();
            let any = hull.iter().any(|p| axis.dot(*p - center) > 0.0);
            let hull = if any { hull } else { &[] };
            let mut seen =
                fit_perspective(light, (eye, basis, DVec2::splat(WIDEST)), hull, None, fitting);
            // Whatever it is seen from, it is lit from the light.
            seen.view.light = (center - fitting.origin).extend(1.0);
            seen
        };
        Ok(vec![side((n, u)), side((-n, -u))])
    }
}

/// How far behind a light the pyramid through its outline has its tip if it is to hold the casters before it: h / d is
/// the tangent of its half aperture, and h (z + d) / d the half side of what it holds at z. Never so near that the widest
/// view would cut off what a receiver within it looks up at z, which reaches out to h + z times that view's tangent.
fn stand_off(light: &Light, hull: &[DVec3], center: DVec3, axis: DVec3) -> f64 {
    let sides = half_sides(light);
    let before = || hull.iter().map(|p| *p - center).filter(|p| axis.dot(*p) > 0.0);
    let farthest = before().map(|p| axis.dot(p)).fold(0.0, f64::max);
    let limit = FARTHEST * farthest;
    let along = |half: DVec3| {
        let h = half.length();
        let e = before().map(|p| half.normalize_or_zero().dot(p).abs()).fold(0.0, f64::max);
        if e > h { (h * farthest / (e - h)).min(limit) } else { limit }
    };
    let least = sides.into_iter().map(DVec3::length).fold(0.0, f64::max) / WIDEST;
    sides.into_iter().map(along).fold(limit, f64::min).max(least)
}
