//! `soft/named_triangles.wesl`: what a triangle hides of a light, as half-planes of it.

use glam::{DVec2, DVec3};

use super::Seen;

impl Seen {
    /// `receiver_from_light` of `soft/named_triangles.wesl`: the receiver relative to the light's centre, in the axes of the
    /// view.
    #[must_use]
    pub fn receiver_from_light(&self) -> DVec3 {
        let slope = (self.texel - self.view.centre) / self.view.texels;
        self.distance_of(self.depth) * slope.extend(1.0)
    }

    /// `in_view`: a direction in the axes of the view.
    #[must_use]
    pub fn in_view(&self, v: DVec3) -> DVec3 {
        DVec3::new(v.dot(self.view.x), v.dot(self.view.y), v.dot(self.view.z))
    }

    /// The way to the light's point at `s`, in coordinates from 0 to 1 of the box around it, in the axes of the view.
    #[must_use]
    pub fn to_light(&self, s: DVec2) -> DVec3 {
        let l = self.lo + s * (self.hi - self.lo);
        if self.view.perspective {
            l.extend(0.0) - self.receiver_from_light()
        } else {
            l.extend(-1.0)
        }
    }

    /// `half_plane`: where [`Seen::to_light`] has a positive part along `w`, as the factors of x, of y and of 1.
    #[must_use]
    pub fn half_plane(&self, w: DVec3) -> DVec3 {
        let rest = if self.view.perspective { -self.receiver_from_light().dot(w) } else { -w.z };
        let across = w.truncate();
        (across * (self.hi - self.lo)).extend(across.dot(self.lo) + rest)
    }

    /// `add_triangle_of`: the half-planes whose common part the triangle with these `corners`, relative to the receiver and in the
    /// axes of the view, hides; `None` where it is behind the receiver or goes through it.
    #[must_use]
    pub fn hidden_by(&self, [a, b, c]: [DVec3; 3]) -> Option<[DVec3; 4]> {
        let n = (b - a).cross(c - a).try_normalize()?;
        let away = a.dot(n);
        if away == 0.0 || a.z.min(b.z).min(c.z) >= 0.0 {
            return None;
        }
        let side = away.signum();
        let before_light = if self.view.perspective {
            self.half_plane(side * n) - DVec3::Z * away.abs()
        } else {
            DVec3::Z
        };
        let edge = |p: DVec3, q: DVec3| self.half_plane(side * p.cross(q));
        Some([edge(a, b), edge(b, c), edge(c, a), before_light])
    }
}

#[cfg(test)]
mod tests {
    use antumbra_scene::Light;
    use glam::{DMat4, DVec4};

    use super::*;
    use crate::Samples;
    use crate::twin::View;
    use crate::twin::mask::Mask;
    use crate::twin::random;

    /// Where the ray along `way` from 0 meets the triangle, as a share of `way` (Möller, Trumbore 1997).
    fn meets([a, b, c]: [DVec3; 3], way: DVec3) -> Option<f64> {
        let (u, v) = (b - a, c - a);
        let p = way.cross(v);
        let det = u.dot(p);
        let x = (-a).dot(p) / det;
        let q = (-a).cross(u);
        let y = way.dot(q) / det;
        let t = v.dot(q) / det;
        (x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.0).then_some(t)
    }

    #[test]
    fn the_half_planes_of_a_triangle_hold_the_samples_whose_rays_meet_it() {
        // Light travels down -z of the clip matrix: a lamp that sees 90 degrees, and a sun over 20 m.
        let lamp = DMat4::from_cols(DVec4::X, DVec4::Y, DVec4::new(0.0, 0.0, 0.0, -1.0), DVec4::Z);
        let sun = DMat4::from_cols(
            DVec4::X * 0.1,
            DVec4::Y * 0.1,
            DVec4::Z * 0.05,
            DVec4::new(0.0, 0.0, 1.0, 1.0),
        );
        let rect = Light::Rect { center: DVec3::ZERO, half_u: DVec3::X, half_v: DVec3::Y * 0.7 };
        let tilted = Light::Rect {
            center: DVec3::ZERO,
            half_u: DVec3::new(0.8, 0.0, 0.5),
            half_v: DVec3::Y * 0.7,
        };
        let ball = Light::Sphere { center: DVec3::ZERO, radius: 0.8 };
        let wide = Light::Directional { direction: DVec3::NEG_Z, angular_diameter: 1.2 };
        let mut state = 17;
        let (mut hidden, mut near_an_edge) = (0, 0);
        for i in 0..20_000 {
            let (clip, light) = [(lamp, rect), (lamp, tilted), (lamp, ball), (sun, wide)][i % 4];
            let view = View::new(&clip, 512.0, &light);
            let texel = DVec2::new(random(&mut state), random(&mut state)) * 512.0;
            let depth = 0.1 + 0.1 * random(&mut state);
            let seen = view.seen(texel, depth);
            // Corners around the receiver and before it, some behind it and some beyond the light.
            let corners = [0; 3].map(|_| {
                let at = [0; 3].map(|_| random(&mut state) * 2.0 - 1.0);
                let z = seen.to_light(DVec2::splat(0.5)).z * (1.4 * at[2] + 0.5);
                DVec3::new(3.0 * at[0], 3.0 * at[1], z)
            });
            let planes = seen.hidden_by(corners);
            for (.., s) in Mask::new(Samples::S64).samples() {
                let inside = planes
                    .is_some_and(|planes| planes.iter().all(|g| g.truncate().dot(s) + g.z >= 0.0));
                let reach = if view.perspective { 1.0 } else { f64::INFINITY };
                let truth = meets(corners, seen.to_light(s)).is_some_and(|t| t <= reach);
                hidden += usize::from(truth);
                if inside != truth {
                    let off = planes.map_or(f64::INFINITY, |planes| {
                        let value = |g: &DVec3| (g.truncate().dot(s) + g.z).abs() / g.length();
                        planes.iter().map(value).fold(f64::INFINITY, f64::min)
                    });
                    assert!(off < 1e-12, "{light:?}: {corners:?} at {s}, {off} from an edge");
                    near_an_edge += 1;
                }
            }
        }
        assert!(hidden > 50_000, "the trial is not an idle one: {hidden} samples hidden");
        assert!(near_an_edge < 5, "{near_an_edge} samples on edges");
    }

    #[test]
    fn half_planes_mark_the_samples_that_are_in_all_of_them() {
        let mut state = 23;
        for i in 0..20_000 {
            let samples = [Samples::S64, Samples::S256, Samples::S1024][i % 3];
            // Through points near the light; some along the lines of samples.
            let mut planes = [DVec3::Z; 5];
            for g in planes.iter_mut().take(1 + i % 5) {
                let [x, y, p, q] = [0; 4].map(|_| random(&mut state) * 2.0 - 1.0);
                let x = if random(&mut state) < 0.2 { 0.0 } else { x };
                *g = DVec3::new(x, y, -x * (p + 0.5) - y * (q + 0.5));
            }
            let mut mask = Mask::new(samples);
            mask.add_half_planes(&planes);
            let mut brute = Mask::new(samples);
            for (s, column, row, at) in brute.samples() {
                if planes.iter().all(|g| g.truncate().dot(at) + g.z >= 0.0) {
                    brute.add_sample(s, column, row);
                }
            }
            assert_eq!(mask, brute, "{samples:?}: {planes:?}");
        }
    }

    #[test]
    fn a_half_plane_and_its_rest_share_no_sample_and_leave_none_out() {
        let mut state = 29;
        for _ in 0..20_000 {
            let [x, y, z] = [0; 3].map(|_| (random(&mut state) * 64.0).floor() / 32.0 - 1.0);
            let g = DVec3::new(if x == 0.0 { 1.0 } else { x }, y, z);
            let mark = |g: DVec3| {
                let mut mask = Mask::new(Samples::S256);
                mask.add_half_planes(&[g, DVec3::Z, DVec3::Z, DVec3::Z, DVec3::Z]);
                mask
            };
            let (one, rest) = (mark(g), mark(-g));
            assert_eq!(one.count() + rest.count(), 256, "{g}");
            assert_eq!(one.count_in(&rest), 0, "{g}");
        }
    }
}
