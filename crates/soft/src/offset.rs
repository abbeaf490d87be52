//! Views from behind a flat light, into slices parallel to it.

use antumbra_gpu::{Frame, GpuError, check_light};
use antumbra_map::{Arrange, Fitting, Layout, Omni, SeenView, Sight, fit_wide};
use antumbra_scene::Light;
use glam::{DMat3, DVec2, DVec3, DVec4};

use crate::Facing;
use crate::facing::{axes, face_of, faces, half_sides};

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
    fn facing(&self) -> Facing {
        Facing { hard: self.hard, whole: false }
    }

    /// Half-spaces around the receivers of a view, by its number; points are relative to `origin`.
    pub(crate) fn served(light: &Light, view: usize, origin: DVec3) -> Vec<DVec4> {
        let Some(center) = light.position() else { return Vec::new() };
        let center = center - origin;
        if Self::is_flat(light) {
            let [.., n] = axes(light);
            return vec![before(center, if view == 0 { n } else { -n })];
        }
        faces(light).get(view).map_or_else(Vec::new, |(_, basis)| face_of(center, basis).to_vec())
    }

    fn is_flat(light: &Light) -> bool {
        !light.is_hard() && matches!(light, Light::Rect { .. } | Light::Disc { .. })
    }
}

impl Arrange for Offset {
    fn layout(&self, light: &Light) -> Layout {
        if Self::is_flat(light) {
            return Layout::of_matrices("soft::layout_sides", 2);
        }
        self.facing().layout(light)
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        let light = frame.light;
        let facing = self.facing();
        let (true, Some(center)) = (Self::is_flat(light), light.position()) else {
            return facing.fit(frame, hull, sight, fitting);
        };
        check_light(light)?;
        // Its checks of the light's size, too.
        facing.fit(frame, &[], None, fitting)?;
        let [u, v, n] = axes(light);
        let sight = sight.filter(|_| fitting.usable() >= 1.0);
        let side = |(axis, right): (DVec3, DVec3)| {
            let served = [before(center - fitting.origin, axis)];
            let stand_off = if self.offset {
                let matter = sight.and_then(|sight| sight.needed(light, &served, |_| 0.0, fitting));
                let matter = matter.map(|needed| needed.casters);
                stand_off(light, hull, matter.as_deref(), (center, axis), fitting.origin)
            } else {
                0.0
            };
            let eye = center - axis * stand_off - fitting.origin;
            let basis = DMat3::from_cols(right, v, -axis).transpose();
            let any = hull.iter().any(|p| axis.dot(*p - center) > 0.0);
            let hull = if any { hull } else { &[] };
            let stand = (eye, basis, DVec2::splat(WIDEST));
            let mut seen = fit_wide(light, stand, &served, hull, sight, fitting);
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
///
/// Of the casters those count that `matter` (relative to `origin`), where that is known. As these follow the camera, the
/// distance then comes in steps of the root of two, so that images stand still between them.
fn stand_off(
    light: &Light,
    hull: &[DVec3],
    matter: Option<&[DVec3]>,
    (center, axis): (DVec3, DVec3),
    origin: DVec3,
) -> f64 {
    let sides = half_sides(light);
    let before = |points: &[DVec3], center: DVec3| -> Vec<DVec3> {
        points.iter().map(|p| *p - center).filter(|p| axis.dot(*p) > 0.0).collect()
    };
    let reach = |points: &[DVec3]| points.iter().map(|p| axis.dot(*p)).fold(0.0, f64::max);
    let all = before(hull, center);
    let limit = FARTHEST * reach(&all);
    let points = matter.map_or_else(|| all.clone(), |matter| before(matter, center - origin));
    let farthest = reach(&points);
    let along = |half: DVec3| {
        let h = half.length();
        let aside = points.iter().map(|p| half.normalize_or_zero().dot(*p).abs());
        let e = aside.fold(0.0, f64::max);
        if e > h { (h * farthest / (e - h)).min(limit) } else { limit }
    };
    let least = sides.into_iter().map(DVec3::length).fold(0.0, f64::max) / WIDEST;
    let found = sides.into_iter().map(along).fold(limit, f64::min);
    let steps = ((found / limit).log2() * 2.0).floor();
    let stepped =
        if matter.is_some() && steps.is_finite() { limit * (0.5 * steps).exp2() } else { found };
    stepped.max(least)
}

/// The half-space before a flat light at `center`.
fn before(center: DVec3, axis: DVec3) -> DVec4 {
    axis.extend(-axis.dot(center))
}
