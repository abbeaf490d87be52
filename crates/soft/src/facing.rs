//! Views from the centre of an area light: a cube turned as the light is.

use antumbra_gpu::{Frame, GpuError, check_light};
use antumbra_map::{Arrange, Fitting, Layout, Omni, SeenView, Sight, cone, fit_wide, fit_wide_sun};
use antumbra_scene::Light;
use glam::{DMat3, DVec2, DVec3, DVec4};

/// One view for a wide sun; six for a sphere, a rectangle or a disc, of which two are parallel to it. A light without an
/// extent has the views of [`Omni`].
///
/// A view's window is that of the casters that hide any point of the light from visible receivers: which need not lie on the
/// way to the light's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Facing {
    /// Layout of point lights, and of lights of size 0.
    pub hard: Omni,
    /// Whether all casters count, for what measures how far it is to a shadow's border, wherever that falls.
    pub whole: bool,
}

/// The half width of a face, tangent of an angle: 90 degrees' and the room for search windows beyond, which grow without
/// bounds as casters come near the light. At 3 a caster is missed that lies nearer than half the light's half size to its
/// plane and more than 72 degrees off the face's axis.
const WIDEST: f64 = 3.0;

impl Arrange for Facing {
    fn layout(&self, light: &Light) -> Layout {
        if light.is_hard() {
            return self.hard.layout(light);
        }
        match light {
            Light::Directional { .. } => Layout::single(),
            _ => Layout::of_matrices("soft::layout_turned", 6),
        }
    }

    fn spread(&self, light: &Light) -> f64 {
        match light {
            Light::Directional { .. } => half_sides(light)[0].length(),
            _ => 0.0,
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
        check_extent(light)?;
        if light.is_hard() {
            return self.hard.fit(frame, hull, sight, fitting);
        }
        let sight = sight.filter(|_| !self.whole);
        check_light(light)?;
        let center = match *light {
            Light::Directional { direction, .. } => {
                let direction = direction.normalize();
                return Ok(vec![fit_wide_sun(light, direction, hull, sight, fitting)]);
            }
            _ => light.position().unwrap_or_default(),
        };
        let extent = half_sides(light).iter().map(|half| half.length()).sum::<f64>();
        let eye = center - fitting.origin;
        let face = |(axis, basis): (DVec3, DMat3)| {
            let nearest = hull.iter().map(|p| axis.dot(*p - center)).fold(f64::INFINITY, f64::min);
            let room = if nearest > 0.0 { extent / nearest } else { WIDEST };
            let tan_limit = DVec2::splat((1.0 + room).min(WIDEST));
            // A face that no caster lies in has no view.
            let hull = if in_reach(hull, center, &basis, tan_limit.x) { hull } else { &[] };
            let served = face_of(eye, &basis);
            fit_wide(light, (eye, basis, tan_limit), &served, hull, sight, fitting)
        };
        Ok(faces(light).map(face).to_vec())
    }
}

/// The axes of the six faces around a light, and their bases: rows are right, up and back.
pub(crate) fn faces(light: &Light) -> [(DVec3, DMat3); 6] {
    let [u, v, n] = axes(light);
    [(u, v), (-u, v), (v, n), (-v, n), (n, v), (-n, v)].map(|(axis, up)| {
        let back = -axis;
        (axis, DMat3::from_cols(up.cross(back), up, back).transpose())
    })
}

/// The half-spaces around the receivers that look into the face of a light at `eye` with that basis.
pub(crate) fn face_of(eye: DVec3, basis: &DMat3) -> [DVec4; 4] {
    cone(eye, basis, DVec2::ONE)
}

/// Whether some of the hull of `points` may lie in the pyramid from `eye` down -z of `basis`, of half-angle tangent `tan`: not
/// if all of them lie beyond one of its sides, or behind.
fn in_reach(points: &[DVec3], eye: DVec3, basis: &DMat3, tan: f64) -> bool {
    let local = || points.iter().map(|p| *basis * (*p - eye));
    let sides: [fn(DVec3, f64) -> f64; 5] = [
        |v, t| -t * v.z - v.x,
        |v, t| -t * v.z + v.x,
        |v, t| -t * v.z - v.y,
        |v, t| -t * v.z + v.y,
        |v, _| -v.z,
    ];
    sides.iter().all(|side| local().any(|v| side(v, tan) >= 0.0))
}

/// Right-handed unit axes of a light: along its sides, and its normal. The world's for a sphere.
#[must_use]
pub(crate) fn axes(light: &Light) -> [DVec3; 3] {
    let (u, v) = match *light {
        Light::Rect { half_u, half_v, .. } => (half_u, half_v),
        Light::Disc { axis_u, axis_v, .. } => (axis_u, axis_v),
        Light::Directional { direction, .. } => direction.normalize().any_orthonormal_pair(),
        _ => (DVec3::X, DVec3::Y),
    };
    // A rectangle may be a line.
    let u = u.try_normalize().or_else(|| v.try_normalize().map(|v| v.any_orthonormal_vector()));
    let u = u.unwrap_or(DVec3::X);
    let v = v.reject_from_normalized(u).try_normalize();
    let v = v.unwrap_or_else(|| u.any_orthonormal_vector());
    [u, v, u.cross(v)]
}

/// Half the sides of a light, metres; of a wide sun those of the disc at the distance 1. No side is less than a
/// thousandth of the other, so that a line of light has an area.
#[must_use]
pub(crate) fn half_sides(light: &Light) -> [DVec3; 2] {
    let [u, v, _] = axes(light);
    let (a, b) = match *light {
        Light::Rect { half_u, half_v, .. } => (half_u.length(), half_v.length()),
        Light::Disc { radius, .. } | Light::Sphere { radius, .. } => (radius, radius),
        Light::Directional { angular_diameter, .. } => {
            let radius = (0.5 * angular_diameter).tan();
            (radius, radius)
        }
        Light::Point { .. } | Light::Spot { .. } => (0.0, 0.0),
    };
    [u * a.max(1e-3 * b), v * b.max(1e-3 * a)]
}

/// Checks the size of a light.
fn check_extent(light: &Light) -> Result<(), GpuError> {
    let (ok, fix) = match *light {
        Light::Directional { angular_diameter, .. } => (
            (0.0..3.1).contains(&angular_diameter),
            "use an angular diameter from 0 to 3.1 radians",
        ),
        Light::Sphere { radius, .. } | Light::Disc { radius, .. } => {
            (radius.is_finite() && radius >= 0.0, "use a finite radius of at least 0")
        }
        Light::Rect { half_u, half_v, .. } => {
            (half_u.is_finite() && half_v.is_finite(), "give finite half sides")
        }
        Light::Point { .. } | Light::Spot { .. } => (true, ""),
    };
    if ok {
        return Ok(());
    }
    Err(GpuError::Invalid { what: "size of the light", value: format!("{light:?}"), fix })
}
