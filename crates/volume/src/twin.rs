//! Containment in the volumes of triangles in f64: the truth of the shaders in tests.

use glam::{DVec3, DVec4};

/// The volume of a triangle a b c under the homogeneous light L, as the signs of four planes; `None` where the light lies
/// in the triangle's plane, whose volume is empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// +1 where the corners run counter-clockwise as the light sees them, else -1.
    pub k: f64,
    corners: [DVec3; 3],
    light: DVec4,
}

impl Volume {
    /// The volume of a triangle.
    #[must_use]
    pub fn new(light: DVec4, corners: [DVec3; 3]) -> Option<Self> {
        let [a, b, c] = corners;
        let n = (b - a).cross(c - a);
        let k = n.dot(light.truncate() - a * light.w);
        (k != 0.0).then(|| Self { k: k.signum(), corners, light })
    }

    /// Distances of `p` from the planes of the three sides and of the triangle, metres, positive outside; 0 for a
    /// side whose edge or whose ray from the light has no length.
    #[must_use]
    pub fn distances(&self, p: DVec3) -> [f64; 4] {
        let [a, b, c] = self.corners;
        let away = |v: DVec3| v * self.light.w - self.light.truncate();
        let side = |a: DVec3, b: DVec3| {
            let normal = (b - a).cross(away(a)).normalize_or_zero();
            self.k * normal.dot(p - a)
        };
        let cap = self.k * (b - a).cross(c - a).normalize_or_zero().dot(p - a);
        [side(b, a), side(c, b), side(a, c), cap]
    }

    /// Whether `p` is in the volume: its sides belong to it, its triangle does not.
    #[must_use]
    pub fn contains(&self, p: DVec3) -> bool {
        let [x, y, z, cap] = self.distances(p);
        x <= 0.0 && y <= 0.0 && z <= 0.0 && cap < 0.0
    }
}

impl Volume {
    /// What counting behind makes of this volume for a sample at `p` on a line of sight from `eye` along `way`: faces
    /// that the line meets, judged by the side on which `p` is. 1 or 0 as `contains` where the line passes through `p`;
    /// of a line drawn aside it tells what becomes of the count.
    #[must_use]
    pub fn count_behind(&self, eye: DVec3, way: DVec3, p: DVec3) -> i32 {
        let [a, b, c] = self.corners;
        // Counter-clockwise as the light sees them.
        let [a, b, c] = if self.k > 0.0 { [a, b, c] } else { [a, c, b] };
        let far = |v: DVec3| (v * self.light.w - self.light.truncate()).extend(0.0);
        let near = |v: DVec3| v.extend(1.0);
        // Outward faces, as polygons of homogeneous points that run counter-clockwise seen from outside.
        let side = |a: DVec3, b: DVec3| vec![near(b), near(a), far(a), far(b)];
        let caps = [vec![near(a), near(b), near(c)], vec![far(c), far(b), far(a)]];
        let faces = [side(a, b), side(b, c), side(c, a)].into_iter().chain(caps);
        let mut count = 0;
        for (index, face) in faces.enumerate() {
            // The line passes a polygon on the inner side of all its edges: it sees it counter-clockwise.
            let seen = |v: DVec4| v.truncate() - eye * v.w;
            let edges = (0..face.len()).map(|i| {
                let (u, v) = (seen(face[i]), seen(face[(i + 1) % face.len()]));
                u.cross(v).dot(way)
            });
            let edges: Vec<f64> = edges.filter(|e| *e != 0.0).collect();
            let towards_eye = edges.iter().all(|e| *e < 0.0);
            if edges.is_empty() || !(towards_eye || edges.iter().all(|e| *e > 0.0)) {
                continue;
            }
            // Met before the eye and not behind it if the way is a sum of ways to corners, not of their opposites.
            let [u, v, w] = [face[0], face[1], face[2]].map(seen);
            let forward = (u.cross(v).dot(w) < 0.0) == towards_eye;
            let outer = match index {
                0..3 => {
                    let (b, a) = (face[0].truncate(), face[1].truncate());
                    (a - b).cross(face[3].truncate()).dot(p - b) > 0.0
                }
                3 => (b - a).cross(c - a).dot(p - a) >= 0.0,
                _ => false,
            };
            if forward && (towards_eye == outer) {
                count += if towards_eye { -1 } else { 1 };
            }
        }
        count
    }
}

/// The number of volumes that contain `p`: of triangles between it and the light.
#[must_use]
pub fn count(light: DVec4, triangles: impl IntoIterator<Item = [DVec3; 3]>, p: DVec3) -> usize {
    let volumes = triangles.into_iter().filter_map(|corners| Volume::new(light, corners));
    volumes.filter(|volume| volume.contains(p)).count()
}

/// Steps of a power of two in `volume/translucent.wesl`.
const STEPS: f32 = 1_048_576.0;
/// As many powers of two leave nothing.
const DARK: u32 = 32 << 20;

/// How many powers of two of the light an opacity in [0, 1] keeps, in steps of 2^-20; at most 32 of them, which is all. The
/// twin of `powers_kept`.
#[must_use]
pub fn powers_kept(opacity: f32) -> u32 {
    let through = 1.0 - opacity;
    if through <= 0.0 {
        DARK
    } else {
        ((-through.log2() * STEPS).round().max(0.0) as u32).min(DARK)
    }
}

/// What so many steps leave of the light. The twin of `left_by`.
#[must_use]
pub fn light_left(powers: u32) -> f32 {
    if powers >= DARK {
        return 0.0;
    }
    let part = (powers & (STEPS as u32 - 1)) as f32 / STEPS;
    (-part).exp2() * (-((powers >> 20) as f32)).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 2 m at a height of 2 m.
    fn square() -> [[DVec3; 3]; 2] {
        let [a, b, c, d] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, z)| DVec3::new(x, 2.0, z));
        // The second the other way round.
        [[a, b, c], [a, d, c]]
    }

    #[test]
    fn a_square_shadows_a_square_of_three_metres_under_a_light_three_times_as_high() {
        let light = DVec4::new(0.0, 6.0, 0.0, 1.0);
        for (x, z, n) in [(1.4, 1.3, 1), (-1.4, 0.2, 1), (1.6, 0.0, 0), (0.3, -1.6, 0)] {
            assert_eq!(count(light, square(), DVec3::new(x, 0.0, z)), n, "at {x}, {z}");
        }
        // Above the square, and above the light, nothing is in shadow.
        assert_eq!(count(light, square(), DVec3::new(0.2, 2.5, 0.1)), 0, "between");
        assert_eq!(count(light, square(), DVec3::new(0.2, 7.0, 0.1)), 0, "beyond the light");
    }

    #[test]
    fn parallel_light_at_45_degrees_moves_the_shadow_by_the_height() {
        let light = DVec4::new(0.5_f64.sqrt(), 0.5_f64.sqrt(), 0.0, 0.0);
        for (x, n) in [(-2.9, 1), (-1.1, 1), (-3.1, 0), (-0.9, 0)] {
            assert_eq!(count(light, square(), DVec3::new(x, 0.0, 0.3)), n, "at {x}");
        }
    }

    #[test]
    fn counting_behind_along_the_line_through_the_sample_tells_whether_it_is_inside() {
        // SplitMix64 (Steele, Lea, Flood 2014), as numbers in [-1, 1).
        let mut state = 7_u64;
        let mut next = || {
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 11) as f64 * 0.5f64.powi(52) - 1.0
        };
        let mut inside = 0;
        for i in 0..20_000 {
            let mut point = || DVec3::new(next(), next(), next());
            let [a, b, c, light, eye, p] = std::array::from_fn(|_| point());
            let light = if i % 2 == 0 { (3.0 * light).extend(1.0) } else { light.extend(0.0) };
            let volume = Volume::new(light, [a, b, c]).expect("in general position");
            let expected = i32::from(volume.contains(p));
            inside += expected;
            assert_eq!(volume.count_behind(eye, p - eye, p), expected, "case {i}");
        }
        assert!(inside > 500, "{inside} points inside");
    }

    #[test]
    fn a_diagonal_is_in_both_volumes_and_a_light_in_the_plane_has_none() {
        let light = DVec4::new(0.0, 6.0, 0.0, 1.0);
        assert_eq!(count(light, square(), DVec3::new(0.75, 0.0, 0.75)), 2, "the shared side");
        let beside = DVec4::new(5.0, 2.0, 0.0, 1.0);
        assert_eq!(count(beside, square(), DVec3::ZERO), 0, "seen edge-on");
    }
}
