//! Planes that receive shadows, and the projection of casters onto them.

use antumbra_gpu::{Frame, GpuError};
use antumbra_scene::Light;
use glam::{DMat4, DVec3, DVec4};
use serde::{Deserialize, Serialize};

/// A plane that receives shadows, world space: all x with `normal . x + offset = 0`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// Normal, of any length but zero.
    pub normal: DVec3,
    /// Minus the product of the normal with a point of the plane; metres for a unit normal.
    pub offset: f64,
}

impl Plane {
    /// The plane through `point` with the normal `normal`.
    #[must_use]
    pub fn through(point: DVec3, normal: DVec3) -> Self {
        Self { normal, offset: -normal.dot(point) }
    }
}

/// The matrix that casts points along the light's rays onto `plane` (xyz normal, w offset), for `light` a
/// position (w = 1) or a direction towards the light (w = 0), both in the same space (Blinn 1988; *Real-Time
/// Shadows* eq. 2.3):
///
/// ```text
/// M = (plane . light) I - light plane^T
/// ```
///
/// Points of the plane stay where they are and the light itself goes to zero. The fourth coordinate of `M v` is
/// `normal . light - normal . v` for a position: it has the sign of `plane . light` where `v` lies on the
/// plane's side of the light, and only such points cast onto the plane.
#[must_use]
pub fn planar_projection(plane: DVec4, light: DVec4) -> DMat4 {
    let outer = |row: f64| light * row;
    let scaled = DMat4::from_diagonal(DVec4::splat(plane.dot(light)));
    scaled - DMat4::from_cols(outer(plane.x), outer(plane.y), outer(plane.z), outer(plane.w))
}

/// A plane that receives shadows of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Receiver {
    /// xyz unit normal, towards the light, w offset, relative to the frame's origin, metres.
    pub(super) plane: DVec4,
    /// Bound on the distance from the plane of a point that was computed in f32 to lie on it, metres.
    pub(super) tolerance: f64,
}

impl Receiver {
    /// The plane and its tolerance, for shaders.
    pub(super) fn uniform(&self) -> ([f32; 4], f32) {
        (self.plane.as_vec4().to_array(), self.tolerance as f32)
    }
}

/// The light relative to the frame's origin: xyz position and w = 1, or the unit direction towards the light
/// and w = 0. Lights with a size count as their centre.
///
/// # Errors
/// A light with numbers that are no light.
pub(super) fn light_vector(frame: &Frame<'_>) -> Result<DVec4, GpuError> {
    antumbra_gpu::check_light(frame.light)?;
    Ok(match *frame.light {
        Light::Directional { direction, .. } => (-direction.normalize()).extend(0.0),
        _ => (frame.light.position().unwrap_or_default() - frame.origin).extend(1.0),
    })
}

/// A light nearer to a plane than this share of the distances from which that is computed lies in it, and shadows
/// nothing there: 2^-20 is 16 steps of f32.
const IN_PLANE: f64 = 1.0 / 1_048_576.0;

/// Planes whose normals and offsets differ by less, relative to the scene's extent, are one: 2^-22, as much as
/// two floors' vertices are apart by rounding to f32.
const SAME_PLANE: f64 = 1.0 / 4_194_304.0;

/// The planes that receive shadows from the frame's light: those given or, without any, those of the floors among
/// the frame's bodies. Planes that contain the light are left out.
///
/// # Errors
/// A plane that is none.
pub(super) fn receivers(
    planes: &[Plane],
    frame: &Frame<'_>,
    light: DVec4,
) -> Result<Vec<Receiver>, GpuError> {
    let mut found: Vec<Receiver> = Vec::new();
    let extent = extent(frame);
    // A position that was interpolated over a triangle and put back onto its plane is off by the rounding of
    // that plane (3 roundings of the normal, 3 of the product, 1 of each vertex) times the triangle's size, which
    // is at most twice the extent: 14 u, doubled for the sample's own rounding.
    let tolerance = 28.0 * 2f64.powi(-24) * extent;
    let mut add = |plane: DVec4| {
        let plane = plane + DVec4::W * plane.truncate().dot(frame.origin);
        let height = plane.dot(light);
        let scale = if light.w == 0.0 { 1.0 } else { light.truncate().length() + plane.w.abs() };
        if height.abs() <= IN_PLANE * scale {
            return;
        }
        let plane = plane * height.signum();
        let same = |other: &Receiver| {
            let apart = other.plane - plane;
            apart.truncate().length() <= SAME_PLANE
                && apart.w.abs() <= SAME_PLANE * (extent + plane.w.abs())
        };
        if !found.iter().any(same) {
            found.push(Receiver { plane, tolerance });
        }
    };
    if planes.is_empty() {
        frame.casters.bodies(&mut |body| {
            if let Some(floor) = body.floor {
                add(floor);
            }
        });
    }
    for plane in planes {
        add(unit(plane)?);
    }
    Ok(found)
}

fn unit(plane: &Plane) -> Result<DVec4, GpuError> {
    let length = plane.normal.length();
    let unit = plane.normal.extend(plane.offset) / length;
    if unit.is_finite() && length > 0.0 {
        return Ok(unit);
    }
    Err(GpuError::Invalid {
        what: "receiving plane",
        value: format!("{plane:?}"),
        fix: "give a finite normal that is not zero, and a finite offset",
    })
}

/// # Errors
/// A plane that is none.
pub(super) fn validate(planes: &[Plane]) -> Result<(), GpuError> {
    planes.iter().try_for_each(|plane| unit(plane).map(|_| ()))
}

/// Largest distance of a caster from the frame's origin, metres, by the bodies or else by what can cast.
fn extent(frame: &Frame<'_>) -> f64 {
    let mut extent = 0.0_f64;
    let mut visit = |p: DVec3| extent = extent.max((p - frame.origin).length());
    frame.casters.bodies(&mut |body| body.bounds.corners().into_iter().for_each(&mut visit));
    frame.casters.hull(frame.light, &mut visit);
    extent
}

#[cfg(test)]
mod tests {
    use super::*;

    /// HC-01 A: a light 6 m up, a square of half side 1 at 2 m.
    #[test]
    fn the_square_of_hc01_casts_a_square_of_three_metres() {
        let light = DVec4::new(0.0, 6.0, 0.0, 1.0);
        let m = planar_projection(DVec4::Y, light);
        for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let v = m * DVec4::new(x, 2.0, z, 1.0);
            assert_eq!(v / v.w, DVec4::new(1.5 * x, 0.0, 1.5 * z, 1.0), "the corner {x}, {z}");
        }
        let overhead = planar_projection(DVec4::Y, DVec4::Y) * DVec4::new(1.0, 2.0, -1.0, 1.0);
        assert_eq!(overhead / overhead.w, DVec4::new(1.0, 0.0, -1.0, 1.0), "light from above");
        let slanting = DVec4::new(1.0, 1.0, 0.0, 0.0) / std::f64::consts::SQRT_2;
        let v = planar_projection(DVec4::Y, slanting) * DVec4::new(1.0, 2.0, 1.0, 1.0);
        assert!((v / v.w).abs_diff_eq(DVec4::new(-1.0, 0.0, 1.0, 1.0), 1e-15), "at 45 degrees");
    }

    /// HC-02: a light 1 m up amid a triangle from 0.5 m to 2 m.
    #[test]
    fn what_lies_above_the_light_has_the_other_sign() {
        let m = planar_projection(DVec4::Y, DVec4::new(0.0, 1.0, 0.0, 1.0));
        let w = |x, y| (m * DVec4::new(x, y, -2.0, 1.0)).w;
        assert_eq!(
            [w(-1.0, 0.5), w(1.0, 0.5), w(0.0, 2.0)],
            [0.5, 0.5, -1.0],
            "fourth coordinates"
        );
    }

    /// Numbers in [-1, 1) by multiples of the golden ratio's powers (Roberts 2018), scaled by up to 10^3 either way.
    fn vectors(seed: usize) -> [DVec4; 3] {
        let number =
            |i: usize| 2.0 * ((seed * 12 + i + 1) as f64 * 0.618_033_988_749_894_9).fract() - 1.0;
        std::array::from_fn(|v| {
            let scale = 10f64.powf(3.0 * number(4 * v + 3));
            DVec3::new(number(4 * v), number(4 * v + 1), number(4 * v + 2)).extend(1.0) * scale
        })
    }

    #[test]
    fn projected_points_lie_on_the_plane_on_the_ray_from_the_light() {
        let mut tried = 0;
        for seed in 0..1000 {
            let [n, l, v] = vectors(seed);
            let normal = n.truncate().normalize();
            let plane = normal.extend(n.w);
            for light in [l.truncate().extend(1.0), l.truncate().normalize().extend(0.0)] {
                let v = v.truncate().extend(1.0);
                let m = planar_projection(plane, light);
                let q = m * v;
                // Each entry has a rounding of 2^-53 of products of |plane| |light|, four of which are added with |v|.
                let rounding = 16.0 * f64::EPSILON * plane.length() * light.length() * v.length();
                let scale = plane.length().max(1.0);
                assert!(plane.dot(q).abs() <= rounding * scale, "seed {seed}: off the plane");
                assert!(
                    (m * light).length() <= rounding / v.length() * light.length() * scale,
                    "seed {seed}: the light"
                );
                // On the ray: q = (plane . light) v - (plane . v) light, by the compact form's own terms.
                let expected = v * plane.dot(light) - light * plane.dot(v);
                assert!((q - expected).length() <= rounding * scale, "seed {seed}: off the ray");
                // A point of the plane is a fixed point, up to the homogeneous factor.
                let foot = (v.truncate() - normal * plane.dot(v)).extend(1.0);
                let fixed = m * foot - foot * plane.dot(light);
                let bound = 16.0
                    * f64::EPSILON
                    * plane.length()
                    * light.length()
                    * (v.length() + foot.length())
                    * scale;
                assert!(fixed.length() <= bound, "seed {seed}: a point of the plane moves");
                tried += 1;
            }
        }
        assert_eq!(tried, 2000, "all seeds");
    }

    #[test]
    fn planes_that_are_none_are_refused() {
        for (normal, offset) in [(DVec3::ZERO, 0.0), (DVec3::NAN, 0.0), (DVec3::Y, f64::INFINITY)] {
            let refused = validate(&[Plane { normal, offset }]);
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{normal}, {offset}");
        }
        let plane = Plane::through(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.0, 2.0, 0.0));
        assert_eq!(unit(&plane), Ok(DVec4::new(0.0, 1.0, 0.0, -2.0)), "normalised");
    }
}
