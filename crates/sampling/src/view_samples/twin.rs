//! Which buckets a triangle covers, in f64: the truth of `cover` in `sampling/view_samples_casters.wesl` in tests.

use glam::{DVec3, DVec4};

use super::grid::Face;

/// Buckets of a row that a triangle covers, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// The row.
    pub row: u32,
    /// The first bucket.
    pub first: u32,
    /// The last bucket.
    pub last: u32,
}

/// The rows of `face`, `side` buckets a side, that the volume of a triangle covers, widened by `slack` buckets. In a row
/// that holds a corner it may be more than what is covered, up to the triangle's extent.
///
/// Seen from the light the volume is the part of directions (or of parallel rays) between three planes through the light.
/// In bucket coordinates they are half-planes (Olano, Greer 1997), whatever lies behind the light.
#[must_use]
pub fn cover(face: &Face, side: u32, light: DVec4, corners: [DVec3; 3], slack: f64) -> Vec<Run> {
    let [a, b, c] = corners;
    let towards = light.truncate();
    // As `facing` in `common/containment.wesl`: a light whose side f32 cannot tell sees the triangle edge-on.
    let (e, f, to_light) = (b - a, c - a, towards - a * light.w);
    let height = e.cross(f).dot(to_light);
    let magnitudes = (0..3).map(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        ((e[j] * f[k]).abs() + (e[k] * f[j]).abs()) * to_light[i].abs()
    });
    if height.abs() <= 8.0 * 2f64.powi(-24) * magnitudes.sum::<f64>() {
        return Vec::new();
    }
    let k = height.signum();
    let seen = corners.map(|v| v - towards * light.w);
    let distances = seen.map(|d| face.distance.dot(d.extend(1.0)));
    let size = f64::from(side);
    let (mut low, mut high) = ([-slack; 2], [size + slack; 2]);
    if distances.iter().all(|d| *d <= 0.0) {
        return Vec::new();
    }
    if distances.iter().all(|d| *d > 0.0) {
        let places = seen.map(|d| face.place(d).unwrap_or_default());
        for i in 0..2 {
            low[i] = places.iter().map(|p| p[i]).fold(f64::INFINITY, f64::min) - slack;
            high[i] = places.iter().map(|p| p[i]).fold(f64::NEG_INFINITY, f64::max) + slack;
        }
    }
    let edges = [(b, a), (c, b), (a, c)].map(|(from, to)| {
        let n = k * (to - from).cross(from * light.w - towards);
        let at = face.origin - from * (1.0 - light.w);
        [n.dot(face.steps[0]), n.dot(face.steps[1]), n.dot(at)]
    });
    let mut runs = Vec::new();
    let bucket = |x: f64| x.floor().clamp(0.0, size - 1.0) as u32;
    if high[1] < 0.0 || low[1] > size {
        return runs;
    }
    for row in bucket(low[1])..=bucket(high[1]) {
        let band = [f64::from(row) - slack, f64::from(row) + 1.0 + slack];
        let (mut first, mut last) = (low[0], high[0]);
        for [s, t, rest] in edges {
            let most = -rest - (t * band[0]).min(t * band[1]);
            if s > 0.0 {
                last = last.min(most / s + slack);
            } else if s < 0.0 {
                first = first.max(most / s - slack);
            } else if most < 0.0 {
                (first, last) = (f64::INFINITY, f64::NEG_INFINITY);
            }
        }
        if first <= last && last >= 0.0 && first <= size {
            runs.push(Run { row, first: bucket(first), last: bucket(last) });
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use antumbra_map::{Fitting, fit};
    use antumbra_scene::Light;

    use super::*;

    /// SplitMix64 (Steele, Lea, Flood 2014), as numbers in [-1, 1).
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 11) as f64 * 0.5f64.powi(52) - 1.0
        }

        fn point(&mut self) -> DVec3 {
            DVec3::new(self.next(), self.next(), self.next())
        }
    }

    const SIDE: u32 = 16;

    /// Faces over the cube from -1 to 1 under a light, and the light.
    fn faces(light: &Light) -> (Vec<Face>, DVec4) {
        let hull: Vec<DVec3> = (0..8)
            .map(|i| {
                DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 2.0 - 1.0
            })
            .collect();
        let fitting =
            Fitting { origin: DVec3::ZERO, size: SIDE, guard: 1, receivers: false, grid: 1 };
        let views = fit(light, &hull, &fitting).expect("a valid light");
        let at = views[0].light.as_vec4().as_dvec4();
        (views.iter().filter_map(|v| Face::of(v.clip?, at, SIDE)).collect(), at)
    }

    /// Triangles of all sizes under each light, with the faces that they are seen in.
    fn each_triangle(mut visit: impl FnMut(&mut Random, &Face, DVec4, [DVec3; 3])) {
        let mut random = Random(3);
        let lights = [
            Light::sun(0.9, 0.4, 0.0),
            Light::Spot { position: DVec3::Y * 3.0, direction: DVec3::NEG_Y, outer_angle: 0.6 },
            // Amid the casters, so that half of them lie behind each face or cross its plane.
            Light::Point { position: DVec3::new(0.1, 0.2, -0.1) },
        ];
        for light in &lights {
            let (faces, at) = faces(light);
            for turn in 0..300 {
                let size = [0.02, 0.3, 1.0][turn % 3];
                let middle = random.point() * (1.0 - size);
                let corners = std::array::from_fn(|_| middle + random.point() * size);
                for face in &faces {
                    visit(&mut random, face, at, corners);
                }
            }
        }
    }

    fn is_held(runs: &[Run], [s, t]: [u32; 2]) -> bool {
        runs.iter().any(|r| r.row == t && (r.first..=r.last).contains(&s))
    }

    /// How many of random points on triangles lie in buckets that these do not cover, and how many do.
    fn missed(slack: f64) -> (usize, usize) {
        let (mut missed, mut all) = (0, 0);
        each_triangle(|random, face, at, corners| {
            let runs = cover(face, SIDE, at, corners, slack);
            for _ in 0..200 {
                let [u, v] = [0, 1].map(|_| 0.5 + 0.5 * random.next());
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let [a, b, c] = corners;
                let p = a + (b - a) * u + (c - a) * v;
                let Some(place) = face.place(p - at.truncate() * at.w) else { continue };
                if place.iter().all(|x| (0.0..f64::from(SIDE)).contains(x)) {
                    all += 1;
                    missed += usize::from(!is_held(&runs, place.map(|x| x as u32)));
                }
            }
        });
        (missed, all)
    }

    #[test]
    fn a_triangle_covers_the_bucket_of_every_point_on_it() {
        let (missed, all) = missed(1e-9);
        assert!(missed == 0 && all > 100_000, "{missed} of {all} points are missed");
    }

    #[test]
    fn a_triangle_that_covers_too_little_is_found_out() {
        let (missed, all) = missed(-0.1);
        assert!(
            missed * 200 > all,
            "only {missed} of {all} points are missed with a tenth of a bucket less"
        );
    }

    /// Whether a triangle meets a bucket: no line along a side of either has them on its two sides.
    fn meets(triangle: [[f64; 2]; 3], [s, t]: [u32; 2]) -> bool {
        let (s, t) = (f64::from(s), f64::from(t));
        let square = [[s, t], [s + 1.0, t], [s + 1.0, t + 1.0], [s, t + 1.0]];
        let sides = [0, 1, 2].map(|i| {
            let (p, q) = (triangle[i], triangle[(i + 1) % 3]);
            [p[1] - q[1], q[0] - p[0]]
        });
        [[1.0, 0.0], [0.0, 1.0]].into_iter().chain(sides).all(|n| {
            let span = |points: &[[f64; 2]]| {
                let along = points.iter().map(|p| n[0] * p[0] + n[1] * p[1]);
                along.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)))
            };
            let (a, b) = (span(&triangle), span(&square));
            a.0 <= b.1 && b.0 <= a.1
        })
    }

    #[test]
    fn rows_without_a_corner_hold_nothing_but_what_is_covered() {
        let mut rows = 0;
        each_triangle(|_, face, at, corners| {
            let places = corners.map(|v| face.place(v - at.truncate() * at.w));
            let [Some(a), Some(b), Some(c)] = places else { return };
            for run in cover(face, SIDE, at, corners, 0.0) {
                let has_corner = [a, b, c].iter().any(|p| p[1].floor() == f64::from(run.row));
                for s in run.first..=run.last {
                    // What lies beyond the grid counts as in its outermost buckets.
                    let inner = s > 0 && s < SIDE - 1 && run.row > 0 && run.row < SIDE - 1;
                    if inner && !has_corner {
                        rows += 1;
                        assert!(meets([a, b, c], [s, run.row]), "{s} of {run:?} is not covered");
                    }
                }
            }
        });
        assert!(rows > 5_000, "{rows} buckets");
    }
}
