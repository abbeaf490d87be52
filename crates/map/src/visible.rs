//! What can matter for what the camera sees: the visible region, and the space from which casters reach it.
//!
//! A caster shadows a visible receiver only where it meets a segment from that receiver to the light. All such
//! segments lie in the convex hull of the visible region and the light (*Real-Time Shadows* 4.1), so that whatever
//! lies outside of the hull is neither drawn nor fitted to. Everything here errs towards keeping: each half-space is
//! pushed out until it holds every corner of the region and the whole light, so rounding and degenerate shapes cost
//! tightness, never a caster.

use antumbra_gpu::{Frame, ViewCamera};
use antumbra_scene::{Bounds, Light};
use glam::{DMat4, DVec2, DVec3, DVec4};

use crate::fit::basis;

/// The part of space that can hold visible receivers: the boxes around them, cut to the camera's frustum.
/// Relative to the frame's origin, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibleRegion {
    body: Polytope,
    /// How far the region is widened on all sides, so that rounded view samples lie within it.
    pad: f64,
}

/// The boxes of a frame's bodies, in memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub struct BodyBoxes {
    receivers: Vec<Bounds>,
    casters: Vec<Bounds>,
}

impl BodyBoxes {
    /// Collects the boxes, and gives what the frame's camera can see of them; `None` where that is not known, and every
    /// caster counts.
    pub fn visible_region(&mut self, frame: &Frame<'_>) -> Option<VisibleRegion> {
        let camera = frame.camera?;
        let Self { receivers, casters } = self;
        receivers.clear();
        casters.clear();
        let all = frame.casters.bodies(&mut |body| {
            receivers.extend(body.parts);
            if body.can_cast(frame.light) {
                casters.extend(body.parts);
            }
        });
        if all { VisibleRegion::new(&camera, receivers, frame.origin) } else { None }
    }

    /// The boxes (world space, metres) of what can cast shadows under that frame's light.
    #[must_use]
    pub fn casters(&self) -> &[Bounds] {
        &self.casters
    }
}

/// What reaches a part of the visible region.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Reach {
    /// Corners of the receivers' part of the region.
    pub(crate) receivers: Vec<DVec3>,
    /// Half-spaces (xyz inward unit normal, w offset) that hold the segments from these receivers to the light.
    pub(crate) volume: Vec<DVec4>,
}

/// A bounded convex body, as the loops of corners of its faces.
#[derive(Clone, Debug, Default, PartialEq)]
struct Polytope {
    faces: Vec<Face>,
}

#[derive(Clone, Debug, PartialEq)]
struct Face {
    /// xyz inward unit normal, w offset: >= 0 inside.
    plane: DVec4,
    corners: Vec<DVec3>,
}

/// Signed distance of `p` from a half-space's border, > 0 within.
pub(crate) fn side(plane: &DVec4, p: DVec3) -> f64 {
    plane.truncate().dot(p) + plane.w
}

/// `bounds` relative to `origin`.
fn relative(bounds: &Bounds, origin: DVec3) -> Bounds {
    Bounds { min: bounds.min - origin, max: bounds.max - origin }
}

impl VisibleRegion {
    /// The region that `camera` sees of `receivers` (world space), of which there may be none. `None` where the
    /// camera's matrix is no projection.
    #[must_use]
    pub fn new(camera: &ViewCamera, receivers: &[Bounds], origin: DVec3) -> Option<Self> {
        let boxes: Vec<Bounds> = receivers.iter().map(|b| relative(b, origin)).collect();
        let all = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
        if all.is_empty() {
            return Some(Self { body: Polytope::default(), pad: 0.0 });
        }
        let farthest = all.min.abs().max(all.max.abs()).max(camera.eye.abs()).max_element();
        // 16 of the steps that f32 positions have there.
        let pad = farthest * 2f64.powi(-20);
        let frustum: Vec<DVec4> =
            frustum_planes(&camera.clip)?.into_iter().map(|plane| plane + DVec4::W * pad).collect();
        let mut seen = Bounds::EMPTY;
        for bounds in &boxes {
            cut(bounds, &frustum, &mut |p| {
                seen = Bounds { min: seen.min.min(p), max: seen.max.max(p) };
            });
        }
        if seen.is_empty() {
            return Some(Self { body: Polytope::default(), pad });
        }
        let padded = Bounds { min: seen.min - pad, max: seen.max + pad };
        let mut body = Polytope::of_box(&padded);
        frustum.iter().for_each(|plane| body.clip(plane));
        Some(Self { body, pad })
    }

    /// Its corners; none where nothing is visible.
    pub fn corners(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.body.corners()
    }

    /// What reaches the part of the region within the half-spaces `cone` of a light's view; nothing where that part
    /// is empty.
    pub(crate) fn reach(&self, light: &Light, cone: &[DVec4], origin: DVec3) -> Option<Reach> {
        let mut body = self.body.clone();
        cone.iter().for_each(|plane| body.clip(&(*plane + DVec4::W * self.pad)));
        let receivers: Vec<DVec3> = body.corners().collect();
        if receivers.is_empty() {
            return None;
        }
        let volume = match Emitter::of(light, origin) {
            Emitter::Parallel { to_light, slant } => body.swept(to_light, slant),
            Emitter::Around { center, points } => body.joined(center, &points),
        };
        Some(Reach { receivers, volume })
    }
}

/// A light, as far as it matters for what it can be hidden by.
enum Emitter {
    /// Directions within a cone around `to_light`, `slant` the tangent of its half angle.
    Parallel { to_light: DVec3, slant: f64 },
    /// A body around `center` within the hull of `points`.
    Around { center: DVec3, points: Vec<DVec3> },
}

impl Emitter {
    fn of(light: &Light, origin: DVec3) -> Self {
        let around = |center: DVec3, half: DVec3| {
            let center = center - origin;
            let bounds = Bounds { min: center - half, max: center + half };
            Self::Around { center, points: bounds.corners().to_vec() }
        };
        match *light {
            Light::Directional { direction, angular_diameter } => Self::Parallel {
                to_light: -direction.normalize(),
                slant: (0.5 * angular_diameter).tan(),
            },
            Light::Spot { position, .. } | Light::Point { position } => {
                around(position, DVec3::ZERO)
            }
            Light::Sphere { center, radius } | Light::Disc { center, radius, .. } => {
                around(center, DVec3::splat(radius))
            }
            Light::Rect { center, half_u, half_v } => around(center, half_u.abs() + half_v.abs()),
        }
    }
}

/// The half-spaces of a clip matrix, wgpu's clip volume; an infinite far end has none. `None` where the matrix has
/// numbers that are not finite.
fn frustum_planes(clip: &DMat4) -> Option<Vec<DVec4>> {
    let [x, y, z, w] = [0, 1, 2, 3].map(|i| clip.row(i));
    let planes = [w + x, w - x, w + y, w - y, z, w - z];
    let finite = planes.iter().all(|p| p.is_finite());
    let unit = |p: &DVec4| {
        let unit = *p / p.truncate().length();
        unit.is_finite().then_some(unit)
    };
    finite.then(|| planes.iter().filter_map(unit).collect())
}

/// Calls `visit` with the corners of the part of `bounds` within `planes`.
fn cut(bounds: &Bounds, planes: &[DVec4], visit: &mut dyn FnMut(DVec3)) {
    if bounds.is_empty() {
        return;
    }
    let corners = bounds.corners();
    let mut crossing = Vec::new();
    for plane in planes {
        let within = corners.iter().filter(|c| side(plane, **c) >= 0.0).count();
        if within == 0 {
            return;
        }
        if within < corners.len() {
            crossing.push(plane);
        }
    }
    if crossing.is_empty() {
        corners.into_iter().for_each(visit);
    } else {
        let mut body = Polytope::of_box(bounds);
        crossing.into_iter().for_each(|plane| body.clip(plane));
        body.corners().for_each(visit);
    }
}

/// Corners, relative to `origin`, of what lies within `volume` of the boxes `casters` (world space).
pub(crate) fn within(casters: &[Bounds], volume: &[DVec4], origin: DVec3) -> Vec<DVec3> {
    let mut points = Vec::new();
    for bounds in casters {
        cut(&relative(bounds, origin), volume, &mut |p| points.push(p));
    }
    points
}

impl Polytope {
    fn of_box(bounds: &Bounds) -> Self {
        // Corner i has the larger coordinate on axis k where bit k of i is set.
        const FACES: [[usize; 4]; 6] =
            [[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]];
        let corners = bounds.corners();
        let faces = FACES.iter().enumerate().map(|(i, face)| {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            let normal = sign * DVec3::AXES[i / 2];
            let corners = face.map(|c| corners[c]).to_vec();
            Face { plane: normal.extend(-normal.dot(corners[0])), corners }
        });
        Self { faces: faces.collect() }
    }

    fn corners(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.faces.iter().flat_map(|face| face.corners.iter().copied())
    }

    /// Cuts away what lies outside of the half-space, and closes the hole (Sutherland, Hodgman 1974, face by face).
    fn clip(&mut self, plane: &DVec4) {
        let mut cap = Vec::new();
        for face in &mut self.faces {
            let mut kept: Vec<DVec3> = Vec::with_capacity(face.corners.len() + 1);
            for (i, &p) in face.corners.iter().enumerate() {
                let q = face.corners[(i + 1) % face.corners.len()];
                let (at_p, at_q) = (side(plane, p), side(plane, q));
                if at_p >= 0.0 {
                    kept.push(p);
                }
                if (at_p >= 0.0) != (at_q >= 0.0) {
                    let crossing = p + (q - p) * (at_p / (at_p - at_q));
                    kept.push(crossing);
                    cap.push(crossing);
                }
            }
            kept.dedup();
            face.corners = kept;
        }
        self.faces.retain(|face| !face.corners.is_empty());
        if !cap.is_empty() {
            let normal = plane.truncate();
            let (rows, center) = (basis(normal), cap.iter().sum::<DVec3>() / cap.len() as f64);
            let angle = |p: &DVec3| {
                let offset = *p - center;
                rows.row(1).dot(offset).atan2(rows.row(0).dot(offset))
            };
            cap.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
            cap.dedup();
            self.faces.push(Face { plane: *plane, corners: cap });
        }
    }

    /// The half-space with the inward normal `normal` that just holds the body and `more`.
    fn support(&self, normal: DVec3, more: &[DVec3]) -> Option<DVec4> {
        let normal = normal.normalize_or_zero();
        let points = self.corners().chain(more.iter().copied());
        let least = points.map(|p| normal.dot(p)).fold(f64::INFINITY, f64::min);
        (normal != DVec3::ZERO && least.is_finite()).then(|| normal.extend(-least))
    }

    /// Half-spaces around all points from which a light in a direction at most `slant` (a tangent) off `to_light`
    /// is seen through the body: the faces that stay behind, and the outline that sweeps towards the light.
    fn swept(&self, to_light: DVec3, slant: f64) -> Vec<DVec4> {
        let behind = |face: &&Face| {
            let n = face.plane.truncate();
            n.dot(to_light) >= slant * n.cross(to_light).length()
        };
        let mut planes: Vec<DVec4> = self.faces.iter().filter(behind).map(|f| f.plane).collect();
        let rows = basis(to_light);
        let (a, b) = (rows.row(0), rows.row(1));
        let outline: Vec<DVec2> = self.corners().map(|p| DVec2::new(a.dot(p), b.dot(p))).collect();
        for (from, to) in edges(&hull(outline)) {
            let inward = (to - from).perp().normalize_or_zero();
            // A direction off by the slant leaves along such a plane, tilted, at worst.
            let normal = a * inward.x + b * inward.y + slant * to_light;
            if inward != DVec2::ZERO {
                planes.extend(self.support(normal, &[]));
            }
        }
        planes
    }

    /// Half-spaces around the hull of the body and a light around `center` within `points`.
    fn joined(&self, center: DVec3, points: &[DVec3]) -> Vec<DVec4> {
        let holds_light = |face: &&Face| points.iter().all(|p| side(&face.plane, *p) >= 0.0);
        let mut planes: Vec<DVec4> =
            self.faces.iter().filter(holds_light).map(|f| f.plane).collect();
        // The whole body lies in front of the light as seen along the normal of a face that the light is beyond.
        let beyond = |face: &&Face| side(&face.plane, center);
        let Some(front) = self.faces.iter().min_by(|f, g| beyond(f).total_cmp(&beyond(g))) else {
            return planes;
        };
        if beyond(&front) >= 0.0 {
            return planes;
        }
        let axis = front.plane.truncate();
        let rows = basis(axis);
        let (a, b) = (rows.row(0), rows.row(1));
        let offsets: Vec<DVec3> = self.corners().map(|p| p - center).collect();
        if offsets.iter().any(|p| axis.dot(*p) <= 0.0) {
            return planes;
        }
        let tangents =
            offsets.iter().map(|p| DVec2::new(a.dot(*p), b.dot(*p)) / axis.dot(*p)).collect();
        for (from, to) in edges(&hull(tangents)) {
            let inward = (to - from).perp();
            let normal = a * inward.x + b * inward.y - axis * inward.dot(from);
            planes.extend(self.support(normal, points));
        }
        planes
    }
}

/// The corners of the convex hull of `points`, counter-clockwise (Andrew 1979).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let chain = |points: &mut dyn Iterator<Item = &DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for &p in points {
            while let [.., q, r] = chain[..]
                && (r - q).perp_dot(p - r) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut corners = chain(&mut points.iter());
    corners.extend(chain(&mut points.iter().rev()));
    corners
}

/// The edges of a closed polygon.
fn edges(corners: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
    let next = corners.iter().cycle().skip(1);
    corners.iter().copied().zip(next.copied())
}

#[cfg(test)]
mod tests {
    use antumbra_scene::Camera;
    use proptest::prelude::*;

    use super::*;

    fn vector(range: f64) -> impl Strategy<Value = DVec3> {
        [-range..range, -range..range, -range..range].prop_map(DVec3::from_array)
    }

    fn bounds(range: f64, largest: f64) -> impl Strategy<Value = Bounds> {
        (vector(range), vector(1.0), 0.0..largest).prop_map(|(min, size, scale)| Bounds {
            min,
            // Now and then flat.
            max: min + (size.max(DVec3::ZERO) * scale),
        })
    }

    fn camera() -> impl Strategy<Value = (ViewCamera, DVec3)> {
        let angles = (vector(8.0), vector(1.0), 0.2..2.6f64, 0.01..2.0f64);
        (angles, vector(1e5)).prop_map(|((eye, forward, fov_y, near), origin)| {
            let (eye, up) = (eye + origin, DVec3::Y);
            let camera = Camera { eye, target: eye + forward, up, fov_y, near };
            let clip = camera.view_projection(origin, 1.5);
            (ViewCamera { clip, eye: eye - origin }, origin)
        })
    }

    fn lights(origin: DVec3) -> impl Strategy<Value = Light> {
        (vector(12.0), vector(1.0), 0.0..1.0f64, 0..4u8).prop_map(move |(p, d, size, kind)| {
            let (center, direction) = (p + origin, d.normalize_or(DVec3::NEG_Y));
            match kind {
                0 => Light::Directional { direction, angular_diameter: 0.0 },
                1 => Light::Directional { direction, angular_diameter: size },
                2 => Light::Point { position: center },
                _ => Light::Sphere { center, radius: size },
            }
        })
    }

    /// Points within `bounds`, evenly.
    fn inside(bounds: &Bounds, count: usize) -> impl Iterator<Item = DVec3> + '_ {
        // Powers of the inverse of the root of g^4 = g + 1 (Roberts 2018).
        let g = DVec3::new(0.819_172_513, 0.671_043_607, 0.549_700_478);
        (1..=count).map(move |i| bounds.min + (g * i as f64).fract() * (bounds.max - bounds.min))
    }

    fn in_view(camera: &ViewCamera, p: DVec3) -> bool {
        let c = camera.clip * p.extend(1.0);
        c.x.abs() <= c.w && c.y.abs() <= c.w && c.z >= 0.0 && c.z <= c.w
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// Whatever lies between a visible receiver and the light lies within the volume: nothing that casts into
        /// view is ever culled.
        #[test]
        fn every_segment_from_a_visible_receiver_to_the_light_lies_in_the_volume(
            (camera, origin, light) in camera()
                .prop_flat_map(|(camera, origin)| (Just(camera), Just(origin), lights(origin))),
            boxes in prop::collection::vec(bounds(10.0, 6.0), 1..6),
        ) {
            let world: Vec<Bounds> = boxes
                .iter()
                .map(|b| Bounds { min: b.min + origin, max: b.max + origin })
                .collect();
            let region = VisibleRegion::new(&camera, &world, origin).expect("a finite camera");
            let reach = region.reach(&light, &[], origin);
            let seen = boxes.iter().flat_map(|b| inside(b, 200)).filter(|p| in_view(&camera, *p));
            for (i, p) in seen.enumerate() {
                let reach = reach.as_ref().expect("something is visible");
                let t = (i as f64 * 0.618_034).fract();
                let towards = light.towards(p + origin, DVec2::new(t, 0.37));
                // Towards a sun as far as 40 m; towards a light as far as it is.
                let far = if light.position().is_none() { 40.0 } else { 1.0 };
                for share in [0.0, t, 1.0] {
                    let q = p + towards * (share * far);
                    let least = reach.volume.iter().map(|v| side(v, q)).fold(0.0, f64::min);
                    // The point on the segment is itself rounded, 1e5 m from the origin to 1.5e-11 m.
                    prop_assert!(least >= -1e-9, "{q} towards {light:?} lies {least} m outside");
                }
            }
        }

        /// What is cut out of a box holds every point of the box within the half-spaces, and no corner is outside.
        #[test]
        fn a_cut_box_is_what_the_half_spaces_leave_of_it(
            bounds in bounds(3.0, 6.0),
            planes in prop::collection::vec((vector(1.0), -2.0..2.0f64), 1..7),
        ) {
            let planes: Vec<DVec4> = planes
                .into_iter()
                .map(|(n, w)| n.normalize_or(DVec3::X).extend(w))
                .collect();
            let mut corners = Vec::new();
            cut(&bounds, &planes, &mut |p| corners.push(p));
            for p in &corners {
                let least = planes.iter().map(|v| side(v, *p)).fold(f64::INFINITY, f64::min);
                prop_assert!(least > -1e-12, "corner {p} lies {least} outside");
            }
            for p in inside(&bounds, 300) {
                if planes.iter().any(|v| side(v, p) < 0.0) {
                    continue;
                }
                // Within the hull of the corners: no direction separates the point from all of them.
                for n in inside(&Bounds { min: -DVec3::ONE, max: DVec3::ONE }, 60) {
                    let most = corners.iter().map(|c| n.dot(*c - p)).fold(f64::NEG_INFINITY, f64::max);
                    prop_assert!(most >= -1e-9, "{p} is lost towards {n} by {most}");
                }
            }
        }
    }

    #[test]
    fn what_is_behind_the_camera_or_off_to_the_side_of_the_light_is_outside() {
        let camera =
            Camera { eye: DVec3::ZERO, target: -DVec3::Z, up: DVec3::Y, fov_y: 1.0, near: 0.1 };
        let view = ViewCamera { clip: camera.view_projection(DVec3::ZERO, 1.0), eye: DVec3::ZERO };
        let floor =
            Bounds { min: DVec3::new(-50.0, -1.0, -50.0), max: DVec3::new(50.0, -1.0, 50.0) };
        let region = VisibleRegion::new(&view, &[floor], DVec3::ZERO).expect("a finite camera");
        let sun = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
        let lamp = Light::Point { position: DVec3::new(0.0, 5.0, -20.0) };
        let small = |center: DVec3| Bounds { min: center - 0.1, max: center + 0.1 };
        for light in [sun, lamp] {
            let volume = region.reach(&light, &[], DVec3::ZERO).expect("a floor in view").volume;
            let kept = |p: DVec3| !within(&[small(p)], &volume, DVec3::ZERO).is_empty();
            assert!(kept(DVec3::new(0.0, 3.0, -20.0)), "{light:?}: above what is seen");
            assert!(!kept(DVec3::new(0.0, 1.0, 8.0)), "{light:?}: behind the camera");
            assert!(!kept(DVec3::new(30.0, 0.0, -20.0)), "{light:?}: beside the frustum");
            assert!(!kept(DVec3::new(0.0, -3.0, -20.0)), "{light:?}: below the floor");
        }
        // Above the lamp nothing shadows, above the floor under the sun everything does.
        let above = small(DVec3::new(0.0, 9.0, -20.0));
        let kept = |light| {
            let volume = region.reach(&light, &[], DVec3::ZERO).expect("a floor in view").volume;
            !within(&[above], &volume, DVec3::ZERO).is_empty()
        };
        assert!(kept(sun) && !kept(lamp), "a lamp hides behind nothing that hangs above it");
    }

    #[test]
    fn nothing_in_view_needs_nothing() {
        let camera =
            Camera { eye: DVec3::ZERO, target: -DVec3::Z, up: DVec3::Y, fov_y: 1.0, near: 0.1 };
        let clip = camera.view_projection(DVec3::ZERO, 1.0);
        let view = ViewCamera { clip, eye: DVec3::ZERO };
        let behind = Bounds { min: DVec3::splat(1.0), max: DVec3::splat(2.0) };
        let light = Light::Point { position: DVec3::ZERO };
        for receivers in [vec![], vec![behind]] {
            let region = VisibleRegion::new(&view, &receivers, DVec3::ZERO).expect("a camera");
            assert_eq!(region.reach(&light, &[], DVec3::ZERO), None, "{receivers:?}");
        }
        let broken = ViewCamera { clip: DMat4::NAN, ..view };
        assert_eq!(VisibleRegion::new(&broken, &[behind], DVec3::ZERO), None, "no projection");
    }
}
